#!/usr/bin/env bash
# Builds the firmware of each board and prints its use of flash, RAM, stack and tick period, and the
# jitter; fails if a budget is exceeded. Stack and tick are measured on the emulated board
# (tests/board/README.md).
#
#   budget.sh            all boards
#   budget.sh --write    and writes the table in docs/wiring.md
set -euo pipefail
cd "$(dirname "$0")/.."

step() { printf 'budget: %s\n' "$*" >&2; }

scripts/require.sh budget cargo cc pkg-config libclang pip size
scripts/board-engine.sh

target=thumbv7em-none-eabihf
elf=${CARGO_TARGET_DIR:-$PWD/target}/$target/release/firmware
flash_budget=$((64 * 1024))
ram_budget=$((16 * 1024))
table=$(mktemp)
trap 'rm -f "$table"' EXIT

section() { size -A "$elf" | awk -v name="$1" '$1 == name { bytes = $2 } END { print bytes + 0 }'; }

# Prints the budgets of a board, given as its features; adds its row to the table.
measure() {
    local board=$1 memory=$2 flash statics stack ram measured
    step "$board: building the image and the proof that it cannot panic"
    cargo build -q --release -p firmware --target "$target" --no-default-features --features "$board"
    # Links only if the functions that the tick calls cannot panic.
    cargo build -q --release -p firmware --target "$target" --no-default-features \
        --features "$board" --example cannot_panic

    flash=$(($(section .vector_table) + $(section .text) + $(section .rodata) + $(section .data)))
    statics=$(($(section .data) + $(section .bss) + $(section .uninit)))
    stack=$(awk '/^ *STACK/ { sub(/.*LENGTH *= */, ""); print $0 * 1024 }' "$memory")
    ram=$((statics + stack))

    printf '\n%s\n' "$board"
    printf 'flash  %6d of %6d bytes\n' "$flash" "$flash_budget"
    printf 'RAM    %6d of %6d bytes: statics %d, stack %d\n' "$ram" "$ram_budget" "$statics" "$stack"
    printf 'panics none in the tick, the settings and the link: cannot_panic links\n'
    [ "$flash" -le "$flash_budget" ]
    [ "$ram" -le "$ram_budget" ]

    step "$board: measuring tick and stack on the emulated board: some minutes the first time"
    measured=$(cd tests/board && FIRMWARE=$elf env -u RUSTUP_TOOLCHAIN cargo test -q --release \
        --test firmware -- --include-ignored --nocapture budget)
    grep -E '^(tick|stack) ' <<<"$measured"
    printf '| `%s` | %d | %d | %s |\n' "$board" "$flash" "$ram" \
        "$(sed -n 's/^row //p' <<<"$measured")" >>"$table"
}

for memory in firmware/src/board/*.x; do
    board=$(basename "$memory" .x)
    measure "${board//_/-}" "$memory"
    if grep -q BridgeConverterPins "${memory%.x}.rs"; then
        measure "${board//_/-},ads1220" "$memory"
    fi
done
# The last one is the default board's, whose image is left.
measure nucleo-f446re memory.x

if [ "${1:-}" = --write ]; then
    awk -v rows="$table" '
        /^<!-- end of boards -->/ { while ((getline row < rows) > 0) print row; skipping = 0 }
        !skipping
        /^\| board \| flash/ { getline; print; skipping = 1 }
    ' docs/wiring.md >"$table.md"
    cat "$table.md" >docs/wiring.md
    rm "$table.md"
    step 'the table in docs/wiring.md is written'
fi
