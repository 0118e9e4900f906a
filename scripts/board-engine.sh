#!/usr/bin/env bash
# Fetches the library of the emulated board's engine (unicorn) as its authors built it, into
# tests/board/engine, where the board's build finds it (tests/board/.cargo/config.toml). Idempotent.
# Where there is none, the build compiles the engine from its source, which needs cmake.
#
#   BOARD_ENGINE=source     does not fetch it, and removes one that was fetched
set -euo pipefail
cd "$(dirname "$0")/.."
folder=tests/board/engine
wanted=tests/board/engine.txt

say() { printf 'board-engine: %s\n' "$*" >&2; }

if [ "${BOARD_ENGINE:-}" != source ]; then
    if cmp -s "$wanted" "$folder/from.txt"; then exit; fi
    scripts/require.sh board-engine pip
    say 'downloading the engine, built: 16 MB'
fi
rm -rf "$folder"
new=$(mktemp -d)
trap 'rm -rf "$new"' EXIT

# pip takes the package for this machine, and compares its hash.
fetch() {
    python3 -m pip download -q --disable-pip-version-check --no-deps --only-binary :all: \
        --require-hashes -r "$wanted" -d "$new" >&2 &&
        python3 -m zipfile -e "$new"/unicorn-*.whl "$new" &&
        [ -f "$new/unicorn/lib/libunicorn.a" ]
}

if [ "${BOARD_ENGINE:-}" = source ] || ! fetch; then
    say 'the engine is compiled from its source: 2 to 6 minutes, once'
    scripts/require.sh board-engine cmake
    exit
fi
mkdir -p "$folder"
cp "$new/unicorn/lib/libunicorn.a" "$folder/"
cat >"$folder/unicorn.pc" <<'PC'
Name: unicorn
Description: the engine of the emulated board
Version: 2.1.4
Libs: -L${pcfiledir} -lunicorn
PC
# Last, so that it stands for all of them.
cp "$wanted" "$folder/from.txt"
