#!/usr/bin/env bash
# Flashes an image over the debug probe, resets the board and prints its logs: the runner of
# `cargo firmware-flash` and `cargo firmware-debug`.
#
#   probe-run.sh ELF [OPTION OF probe-rs]...
#
# The image says for which chip it is, by a symbol of its memory.x.
set -euo pipefail
elf=$1
shift

chip=$(LC_ALL=C grep -aom1 'chip_STM32[A-Za-z0-9]*' "$elf" | head -n 1) || {
    printf 'probe-run: %s names no chip: a memory.x has a line chip_STM32… = 1;\n' "$elf" >&2
    exit 2
}
# A copy, because the tests of the emulated board use the image. Stops here if it is none.
sealed=$elf.sealed
cp -- "$elf" "$sealed"
"$(dirname "$0")/seal-image.sh" "$sealed"
options=()
if ! LC_ALL=C grep -aq 'watchdog_stops_in_debug' "$elf"; then
    # A caught reset or hard fault would halt the core: before the firmware starts, or before it
    # brings the valve to 0 V. probe-rs catches both unless it is told not to.
    options=(--no-catch-reset --no-catch-hardfault)
fi
exec probe-rs run --chip "${chip#chip_}" "${options[@]}" "$@" "$sealed"
