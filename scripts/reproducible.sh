#!/usr/bin/env bash
# Builds the images of boards twice from HEAD, in two folders of different names and lengths, and
# fails unless all bytes of both are the same: the whole ELF file, its list of parts, too.
#
#   reproducible.sh [BOARD...]     all boards by default
set -euo pipefail
cd "$(dirname "$0")/.."
boards=("$@")
[ $# -gt 0 ] || boards=(nucleo-f446re nucleo-f411re nucleo-f411re,ads1220 stm32f407)
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT

# Commits may be added between the two.
commit=$(git rev-parse HEAD)
for folder in first a/second-one; do
    git clone -q --no-hardlinks . "$temporary/$folder/sources"
    git -C "$temporary/$folder/sources" checkout -q "$commit"
    for board in "${boards[@]}"; do
        # What has been installed is not installed again; what boards have in common is built once.
        (
            unset CARGO_TARGET_DIR
            "$temporary/$folder/sources/scripts/release-image.sh" "$temporary/$folder/out" "$board"
        )
    done >"$temporary/$(basename "$folder").txt"
done
if ! cmp "$temporary/first.txt" "$temporary/second-one.txt"; then
    for one in "$temporary"/first/out/*.elf "$temporary"/first/out/*.cdx.json; do
        cmp "$one" "$temporary/a/second-one/out/$(basename "$one")" || true
    done
    printf 'reproducible: two builds of an image differ\n' >&2
    exit 1
fi
printf 'reproducible: %s: two builds in different folders have the same bytes\n' "${boards[*]}"
cat "$temporary/first.txt"
