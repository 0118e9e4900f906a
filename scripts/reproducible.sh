#!/usr/bin/env bash
# Builds the image of a board twice from HEAD, in two folders of different names and lengths, and
# fails unless all bytes of both are the same: the whole ELF file, its list of parts, too.
#
#   reproducible.sh [BOARD]
set -euo pipefail
cd "$(dirname "$0")/.."
board=${1:-nucleo-f446re}
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT

# Commits may be added between the two.
commit=$(git rev-parse HEAD)
for folder in first a/second-one; do
    git clone -q --no-hardlinks . "$temporary/$folder/sources"
    git -C "$temporary/$folder/sources" checkout -q "$commit"
    (
        unset CARGO_TARGET_DIR
        # What has been installed is not installed again.
        "$temporary/$folder/sources/scripts/release-image.sh" "$temporary/$folder/out" "$board"
    ) >"$temporary/$(basename "$folder").txt"
done
if ! cmp "$temporary/first.txt" "$temporary/second-one.txt"; then
    cmp "$temporary"/first/out/*.elf "$temporary"/a/second-one/out/*.elf || true
    diff "$temporary"/first/out/*.cdx.json "$temporary"/a/second-one/out/*.cdx.json | head -5 || true
    printf 'reproducible: two builds of %s differ\n' "$board" >&2
    exit 1
fi
printf 'reproducible: %s: two builds in different folders have the same bytes\n' "$board"
cat "$temporary/first.txt"
