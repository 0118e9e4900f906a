#!/usr/bin/env bash
# Makes the README's pictures from real runs: docs/report-diagnosis.png from the tutorial of
# docs/diagnosis.md, docs/report-paper.png from the default run. Each shows the first part of the
# report in Chromium's light theme. Needs chromium (or CHROMIUM) and the fonts that the report names
# or DejaVu Sans (`apt install chromium fonts-dejavu-core`).
set -euo pipefail
cd "$(dirname "$0")/.."
width=1080
bytes_max=200000

browser=${CHROMIUM:-}
for name in chromium chromium-browser google-chrome; do
    browser=${browser:-$(command -v "$name" || true)}
done
if [ -z "$browser" ]; then
    echo 'pictures: no Chromium: install it, or name its program in CHROMIUM' >&2
    exit 2
fi
# Not in /tmp, which a Chromium from a snap cannot read.
mkdir -p target
work=$(mktemp -d "$PWD/target/pictures.XXXXXX")
trap 'rm -rf "$work"' EXIT

chromium() {
    local flags=(--headless --disable-gpu --hide-scrollbars --force-device-scale-factor=1
        --blink-settings=preferredColorScheme=1 --virtual-time-budget=5000
        --user-data-dir="$work/profile")
    # As root Chromium refuses to run with its sandbox.
    if [ "$(id -u)" = 0 ]; then flags+=(--no-sandbox); fi
    "$browser" "${flags[@]}" "$@" 2>/dev/null
}

# picture REPORT PNG CSS: the report without what CSS hides, as high as the rest is.
picture() {
    local report=$1 png=$2 css=$3 page=$work/page.html height measure
    measure="setTimeout(() => { document.body.dataset.height ="
    measure="$measure Math.ceil(document.querySelector('main').getBoundingClientRect().bottom); }, 1000);"
    # Legends show values only under the pointer, and a picture has no buttons.
    css="$css footer, .save, .u-legend td, .u-legend tr:first-child, .u-legend th::after"
    css="$css { display: none !important; }"
    css="$css main { padding-bottom: 1.25rem; }"
    sed "s|</head>|<style>$css</style></head>|" "$report" >"$page"
    # A copy whose script writes the height of what is left into the page.
    sed "s|</body>|<script>$measure</script></body>|" "$page" >"$work/measured.html"
    height=$(chromium --window-size="$width,4000" --dump-dom "file://$work/measured.html" |
        sed -n 's/.*data-height="\([0-9]*\)".*/\1/p' | head -n 1)
    if [ -z "$height" ]; then
        echo "pictures: $browser did not render $report" >&2
        exit 1
    fi
    chromium --window-size="$width,$height" --screenshot="$PWD/$png" "file://$page" >/dev/null
    if [ "$(wc -c <"$png")" -gt "$bytes_max" ]; then
        echo "pictures: $png has $(wc -c <"$png") bytes, more than $bytes_max" >&2
        exit 1
    fi
    echo "$png: $width × $height, $(wc -c <"$png") bytes"
}

cargo build --release -p hil-sim -p truth
hil_sim=${CARGO_TARGET_DIR:-target}/release/hil-sim
truth=${CARGO_TARGET_DIR:-target}/release/truth

"$hil_sim" paper --out "$work/paper" >/dev/null
"$truth" --family catalogue-like --seed 1 --effect leak --cases single --count 1 --out "$work/hidden" >/dev/null
case=$work/hidden/cases/s1-00030
"$hil_sim" diagnose --rig "$case/rig.toml" \
    --fit "$case/fit_1.csv" --fit "$case/fit_2.csv" \
    --validate "$case/validate_1.csv" --validate "$case/validate_2.csv" \
    --out "$work/diagnosis" >/dev/null

later='section:nth-of-type(n+3)'
# The gap, in the contraction of the first record, and what is missing.
picture "$work/diagnosis/report.html" docs/report-diagnosis.png \
    "$later, figure:not(:nth-of-type(3)):not(:nth-of-type(4)) { display: none; }"
# The paper's numbers, and the forces with either valve.
picture "$work/paper/report.html" docs/report-paper.png \
    "$later, figure:not(:nth-of-type(1)):not(:nth-of-type(3)) { display: none; }"
