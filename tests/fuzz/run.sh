#!/usr/bin/env bash
# Fuzzes, coverage-guided: `run.sh [INPUTS [TARGET …]]`, ten million each of all unless told
# otherwise, each for FUZZ_TIME_S seconds at most if that is set. What is worth keeping of
# target/corpus goes into seeds, which `cargo test` runs.
# libFuzzer on stable Rust: the instrumentation is LLVM's, which rustc can be told to run.
set -euo pipefail
cd "$(dirname "$0")"
inputs=${1:-10000000}
shift || true
flags='--cfg fuzzing -Cpasses=sancov-module'
for option in level=4 inline-8bit-counters pc-table trace-compares; do
    flags+=" -Cllvm-args=-sanitizer-coverage-$option"
done
# With a target named, build scripts are not instrumented.
host=$(rustc -vV | sed -n 's/^host: //p')
[ $# -gt 0 ] || set -- link settings pipe record mcap rig \
    import import-hdf5 import-log import-matlab import-ros import-sheet
RUSTFLAGS=$flags cargo build --release --target "$host" "${@/#/--bin=}" >&2
for name in "$@"; do
    mkdir -p "target/corpus/$name"
    printf '%s: ' "$name"
    case $name in
        link | settings | pipe) max_len=256 ;;
        record) max_len=512 ;;
        rig) max_len=1024 ;;
        import-ros) max_len=512 ;;
        import-sheet) max_len=1024 ;;
        import*) max_len=20000 ;;
        *) max_len=4096 ;;
    esac
    "target/$host/release/$name" -runs="$inputs" -max_len=$max_len -rss_limit_mb=4096 \
        -max_total_time="${FUZZ_TIME_S:-0}" \
        -artifact_prefix=target/ "target/corpus/$name" "seeds/$name" >"target/$name.log" 2>&1 || true
    grep -E '^Done|ERROR|panicked' "target/$name.log"
    grep -q '^Done' "target/$name.log"
done
