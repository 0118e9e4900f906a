#!/usr/bin/env bash
# Hardware in the loop without hardware, from a fresh clone: builds the firmware, the emulated board
# and hil-sim, then runs `hil-sim hil` with this script's arguments where it was called.
# Some minutes once, then seconds. CROSS_MODE: see setup-cross.sh.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
target=thumbv7em-none-eabihf

step() { printf '\nemulated-hil: %s\n' "$*" >&2; }

# bindgen loads it.
has_libclang() {
    [ "$(uname)" != Linux ] || [ -n "${LIBCLANG_PATH:-}" ] ||
        compgen -G '/usr/lib*/libclang*.so*' >/dev/null ||
        compgen -G '/usr/lib*/*/libclang*.so*' >/dev/null ||
        compgen -G '/usr/lib*/*/lib*/libclang*.so*' >/dev/null
}

missing=()
command -v cc >/dev/null || missing+=(build-essential)
for tool in rustup cargo clang cmake pkg-config; do
    command -v "$tool" >/dev/null || missing+=("$tool")
done
has_libclang || missing+=(libclang-dev)
if [ ${#missing[@]} -gt 0 ]; then
    printf 'emulated-hil: missing: %s\n' "${missing[*]}" >&2
    printf 'rustup and cargo come from https://rustup.rs, the others are packages of Debian and' >&2
    printf ' Ubuntu: sudo apt install …\n' >&2
    exit 2
fi

cd "$root"
built=${CARGO_TARGET_DIR:-$root/target}
board_built=${CARGO_TARGET_DIR:-$root/tests/board/target}

step '1 of 4, cross-compiling'
toolchain=$(scripts/setup-cross.sh)
step '2 of 4, the firmware'
(eval "$toolchain" && cargo firmware)
step '3 of 4, the emulated board: the first time takes some minutes'
cargo build --release --manifest-path tests/board/Cargo.toml --bin emulated-board
step '4 of 4, the simulator'
cargo build --release -p hil-sim
cd "$OLDPWD"

export FIRMWARE=${FIRMWARE:-$built/$target/release/firmware}
export EMULATED_BOARD=${EMULATED_BOARD:-$board_built/release/emulated-board}
exec "$built/release/hil-sim" hil "$@"
