#!/usr/bin/env bash
# Builds the image of a board for others: sealed, with the same bytes wherever it is built from the
# same commit by the same compiler, and with a list of its parts (SBOM, CycloneDX).
#
#   release-image.sh FOLDER [BOARD]     BOARD: features, nucleo-f446re by default
#
# Writes into FOLDER: BOARD.elf, BOARD.cdx.json and BOARD.sha256. Needs setup-cross.sh.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:?the folder to write to}
board=${2:-nucleo-f446re}
target=thumbv7em-none-eabihf
version=0.5.9
built=${CARGO_TARGET_DIR:-$PWD/target}/release-image
mkdir -p "$out"
out=$(cd "$out" && pwd)
name=${board//,/-}

say() { printf 'release-image: %s\n' "$*" >&2; }

if ! cargo cyclonedx --version 2>/dev/null | grep -q " $version\$"; then
    say "installing cargo-cyclonedx $version"
    CARGO_PROFILE_RELEASE_OPT_LEVEL=0 CARGO_PROFILE_RELEASE_LTO=off \
        CARGO_PROFILE_RELEASE_CODEGEN_UNITS=64 CARGO_PROFILE_RELEASE_DEBUG=false \
        CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target}/tools \
        cargo install -q --locked "cargo-cyclonedx@$version"
fi

# Paths of this machine are in panics, in debug information and, by the hash of the packages' places, in
# names of symbols.
home=${CARGO_HOME:-$HOME/.cargo}
flags=''
for map in "$home/registry/src=crates" "$built=target" "$PWD=."; do
    flags+="\"--remap-path-prefix=$map\", "
done
say "$board: image"
CARGO_INCREMENTAL=0 cargo build -q --locked --release -p firmware --target "$target" \
    --target-dir "$built" --no-default-features --features "$board" \
    --config "target.$target.rustflags = [$flags]"
cp "$built/$target/release/firmware" "$out/$name.elf"
scripts/seal-image.sh "$out/$name.elf"

say "$board: parts"
# It writes beside every package of the workspace, with the time and a random number, which do not
# belong to the parts.
parts=parts-of-the-image.cdx
trap 'git ls-files -o --exclude-standard -- "*$parts.json" | xargs -r rm -f' EXIT
cargo cyclonedx -q --manifest-path firmware/Cargo.toml --format json --target "$target" \
    --no-default-features --features "$board" --override-filename "$parts"
grep -vE '"(serialNumber|timestamp)":' "firmware/$parts.json" |
    sed "s|$PWD|.|g" >"$out/$name.cdx.json"

(cd "$out" && sha256sum "$name.elf" "$name.cdx.json" | tee "$name.sha256")
