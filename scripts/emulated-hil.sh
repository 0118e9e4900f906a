#!/usr/bin/env bash
# Hardware in the loop without hardware, from a fresh clone: builds the firmware, the emulated board
# and hil-sim, then runs `hil-sim hil` with this script's arguments where it was called.
# Some minutes once, then seconds. CROSS_MODE: see setup-cross.sh; BOARD_ENGINE: board-engine.sh.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
target=thumbv7em-none-eabihf

step() { printf '\nemulated-hil: %s (%s)\n' "$*" "$(date +%T)" >&2; }

"$root/scripts/require.sh" emulated-hil rustup cargo cc pkg-config libclang pip
cd "$root"
built=${CARGO_TARGET_DIR:-$root/target}
board_built=${CARGO_TARGET_DIR:-$root/tests/board/target}

step '1 of 3, cross-compiling: half a minute the first time'
toolchain=$(scripts/setup-cross.sh)
step '2 of 3, the firmware and the emulated board: two minutes or three the first time'
(eval "$toolchain" && cargo firmware) &
firmware=$!
scripts/board-engine.sh
(cd tests/board && cargo build --release --bin emulated-board)
wait "$firmware"
step '3 of 3, the simulator: a minute or two the first time'
# Without the optimisation of a release, which takes longer than all the rest, serial ports and
# MATLAB; but if there is a release, as that.
profile=quick options=(--no-default-features --features terminal)
if [ -x "$built/release/hil-sim" ]; then profile=release options=(); fi
cargo build --profile "$profile" -p hil-sim "${options[@]}"
cd "$OLDPWD"

export FIRMWARE=${FIRMWARE:-$built/$target/release/firmware}
export EMULATED_BOARD=${EMULATED_BOARD:-$board_built/release/emulated-board}
exec "$built/$profile/hil-sim" hil "$@"
