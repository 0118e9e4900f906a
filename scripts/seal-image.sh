#!/usr/bin/env bash
# Writes length and checksum of a firmware image into its ELF file, in place; the firmware compares
# them at each start. The words are reserved ones of the vector table: see `check_image` in
# model-core/src/link.rs.
#
#   seal-image.sh ELF
set -euo pipefail
elf=$1
image=$(mktemp)
trap 'rm -f "$image"' EXIT

# A number of the ELF file: offset, size in bytes.
number() { od -An -v -t "u$2" -j "$1" -N "$2" "$elf" | tr -d ' '; }

# Writes a little-endian word: file, offset, value.
put() {
    local hex
    hex=$(printf '%08x' "$3")
    printf '%b' "\\x${hex:6:2}\\x${hex:4:2}\\x${hex:2:2}\\x${hex:0:2}" |
        dd of="$1" bs=1 seek="$2" conv=notrunc status=none
}

headers=$(number 28 4) size=$(number 42 2) count=$(number 44 2)
base='' vectors='' length=0
for ((n = 0; n < count; n++)); do
    at=$((headers + n * size))
    offset=$(number $((at + 4)) 4) address=$(number $((at + 12)) 4) bytes=$(number $((at + 16)) 4)
    if [ "$(number "$at" 4)" != 1 ] || [ "$bytes" = 0 ]; then continue; fi
    if [ -z "$base" ]; then base=$address vectors=$offset; fi
    # Between the segments the flash is erased.
    for ((; length < address - base; length++)); do printf '\377' >>"$image"; done
    tail -c "+$((offset + 1))" "$elf" | head -c "$bytes" >>"$image" || true
    length=$((length + bytes))
done
if [ "$base" != $((0x08000000)) ]; then
    printf 'seal-image: %s is not an image for the start of the flash\n' "$elf" >&2
    exit 2
fi
put "$image" $((0x1c)) 0
put "$image" $((0x20)) "$length"
# The last words of a gzip file are the CRC-32 and the length of its content.
crc=$((16#$(gzip -c "$image" | tail -c 8 | head -c 4 | od -An -v -t x4 --endian=little | tr -d ' ')))
put "$elf" $((vectors + 0x20)) "$length"
put "$elf" $((vectors + 0x1c)) "$crc"
