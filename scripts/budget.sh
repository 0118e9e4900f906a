#!/usr/bin/env bash
# Builds the firmware and prints its use of flash, RAM, stack and tick period; fails if a budget is
# exceeded. Stack and tick are measured on the emulated board, which needs cmake, clang,
# libclang-dev and pkg-config.
set -euo pipefail
cd "$(dirname "$0")/.."

step() { printf 'budget: %s\n' "$*" >&2; }

missing=()
for tool in cargo cmake clang pkg-config size; do
    command -v "$tool" >/dev/null || missing+=("$tool")
done
if [ ${#missing[@]} -gt 0 ]; then
    printf 'budget: missing: %s (Debian: cmake clang libclang-dev pkg-config binutils)\n' \
        "${missing[*]}" >&2
    exit 2
fi

target=thumbv7em-none-eabihf
elf=${CARGO_TARGET_DIR:-$PWD/target}/$target/release/firmware
flash_budget=$((64 * 1024))
ram_budget=$((16 * 1024))

step 'building the image and the proof that it cannot panic: a minute the first time'
cargo build -q --release -p firmware --target "$target"
# Links only if the functions that the tick calls cannot panic.
cargo build -q --release -p firmware --target "$target" --example cannot_panic

section() { size -A "$elf" | awk -v name="$1" '$1 == name { bytes = $2 } END { print bytes + 0 }'; }
flash=$(($(section .vector_table) + $(section .text) + $(section .rodata) + $(section .data)))
statics=$(($(section .data) + $(section .bss) + $(section .uninit)))
stack=$(awk '/^ *STACK/ { sub(/.*LENGTH *= */, ""); print $0 * 1024 }' memory.x)
ram=$((statics + stack))

printf 'flash  %6d of %6d bytes\n' "$flash" "$flash_budget"
printf 'RAM    %6d of %6d bytes: statics %d, stack %d\n' "$ram" "$ram_budget" "$statics" "$stack"
printf 'panics none in the tick, the settings and the link: cannot_panic links\n'
[ "$flash" -le "$flash_budget" ]
[ "$ram" -le "$ram_budget" ]

step 'measuring tick and stack on the emulated board: some minutes the first time'
measured=$(FIRMWARE=$elf env -u RUSTUP_TOOLCHAIN cargo test -q --release \
    --manifest-path tests/board/Cargo.toml --test firmware -- --include-ignored --nocapture budget)
grep -E '^(tick|stack) ' <<<"$measured"
