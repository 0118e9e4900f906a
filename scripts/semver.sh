#!/usr/bin/env bash
# Compares the public interface of model-discrepancy with that of the commit in
# model-discrepancy/api-baseline: a change that breaks its users needs another version. Installs
# cargo-semver-checks the first time, which takes some minutes.
set -euo pipefail
cd "$(dirname "$0")/.."
version=0.51.0

if ! cargo semver-checks --version 2>/dev/null | grep -q " $version\$"; then
    printf 'semver: installing cargo-semver-checks %s\n' "$version" >&2
    # It runs for seconds: what counts is how long it takes to build.
    CARGO_PROFILE_RELEASE_OPT_LEVEL=0 CARGO_PROFILE_RELEASE_LTO=off \
        CARGO_PROFILE_RELEASE_CODEGEN_UNITS=64 CARGO_PROFILE_RELEASE_DEBUG=false \
        CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target}/tools \
        cargo install -q --locked "cargo-semver-checks@$version"
fi

baseline=$(cat model-discrepancy/api-baseline)
if ! git cat-file -e "$baseline^{commit}" 2>/dev/null; then
    printf 'semver: not run: %s, the baseline, is not in this clone without its whole history\n' \
        "$baseline" >&2
    exit 0
fi
cargo semver-checks -p model-discrepancy --baseline-rev "$baseline"
