#!/usr/bin/env bash
# Fuzzes each target, coverage-guided: `run.sh [INPUTS]`, ten million each unless told otherwise.
# libFuzzer on stable Rust: the instrumentation is LLVM's, which rustc can be told to run.
set -euo pipefail
cd "$(dirname "$0")"
inputs=${1:-10000000}
flags='--cfg fuzzing -Cpasses=sancov-module -Ccodegen-units=1'
for option in level=4 inline-8bit-counters pc-table trace-compares; do
    flags+=" -Cllvm-args=-sanitizer-coverage-$option"
done
# With a target named, build scripts are not instrumented.
host=$(rustc -vV | sed -n 's/^host: //p')
RUSTFLAGS=$flags cargo build --release --target "$host" >&2
for target in src/bin/*.rs; do
    name=$(basename "$target" .rs)
    mkdir -p "target/corpus/$name" "seeds/$name"
    printf '%s: ' "$name"
    "target/$host/release/$name" -runs="$inputs" -max_len=2200 -rss_limit_mb=4096 \
        "target/corpus/$name" "seeds/$name" 2>&1 |
        tee "target/$name.log" | grep -E '^Done|ERROR|panicked' || { tail "target/$name.log"; exit 1; }
    grep -q '^Done' "target/$name.log"
done
