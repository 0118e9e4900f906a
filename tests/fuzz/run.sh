#!/usr/bin/env bash
# Fuzzes, coverage-guided: `run.sh [INPUTS [TARGET …]]`, ten million each of all unless told
# otherwise. What is worth keeping of target/corpus goes into seeds, which `cargo test` runs.
#
#   FUZZ_TIME_S=30      each for so many seconds at most
#   FUZZ_JOBS=2         so many at a time
#   FUZZ_COMPARES=no    does not trace what is compared: a new path is found later, but the importers
#                       take some four times as many inputs a second
#
# libFuzzer on stable Rust: the instrumentation is LLVM's, which rustc can be told to run.
set -euo pipefail
cd "$(dirname "$0")"
inputs=${1:-10000000}
shift || true
built=$PWD/target
options='level=4 inline-8bit-counters pc-table'
if [ "${FUZZ_COMPARES:-yes}" = no ]; then built+=/no-compares; else options+=' trace-compares'; fi
flags='--cfg fuzzing -Cpasses=sancov-module'
for option in $options; do
    flags+=" -Cllvm-args=-sanitizer-coverage-$option"
done
# With a target named, build scripts are not instrumented.
host=$(rustc -vV | sed -n 's/^host: //p')
[ $# -gt 0 ] || set -- link settings pipe record mcap rig \
    import import-hdf5 import-log import-matlab import-ros import-sheet
RUSTFLAGS=$flags CARGO_TARGET_DIR=$built \
    cargo build --release --target "$host" "${@/#/--bin=}" >&2

fuzz() {
    local name=$1 max_len
    case $name in
        link | settings | pipe) max_len=256 ;;
        record) max_len=512 ;;
        rig) max_len=1024 ;;
        import-ros) max_len=512 ;;
        import-sheet) max_len=1024 ;;
        import*) max_len=20000 ;;
        *) max_len=4096 ;;
    esac
    mkdir -p "target/corpus/$name"
    "$built/$host/release/$name" -runs="$inputs" -max_len=$max_len -rss_limit_mb=4096 \
        -timeout=20 -max_total_time="${FUZZ_TIME_S:-0}" \
        -artifact_prefix=target/ "target/corpus/$name" "seeds/$name" >"target/$name.log" 2>&1 || true
    # A failure's input is named, below tests/fuzz.
    printf '%s: %s\n' "$name" \
        "$(grep -E '^Done|ERROR|panicked|Test unit written' "target/$name.log")"
    grep -q '^Done' "target/$name.log"
}

running=0 failed=0
for name in "$@"; do
    if [ "$running" -ge "${FUZZ_JOBS:-1}" ]; then
        wait -n || failed=1
        running=$((running - 1))
    fi
    fuzz "$name" &
    running=$((running + 1))
done
while [ "$running" -gt 0 ]; do
    wait -n || failed=1
    running=$((running - 1))
done
exit $failed
