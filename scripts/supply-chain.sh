#!/usr/bin/env bash
# Checks licences, origin and versions of all dependencies of the four workspaces with cargo-deny, by
# deny.toml and tests/board/deny.toml, and known vulnerabilities where their database can be reached;
# otherwise it says that they were not checked. Installs cargo-deny the first time, which takes some
# minutes.
#
#   supply-chain.sh [--need-advisories]    fails, too, if the database cannot be reached
set -euo pipefail
cd "$(dirname "$0")/.."
version=0.20.2
need_advisories=${1:-}

say() { printf 'supply-chain: %s\n' "$*" >&2; }

if ! cargo deny --version 2>/dev/null | grep -q " $version\$"; then
    say "installing cargo-deny $version"
    # It runs for seconds: what counts is how long it takes to build.
    CARGO_PROFILE_RELEASE_OPT_LEVEL=0 CARGO_PROFILE_RELEASE_LTO=off \
        CARGO_PROFILE_RELEASE_CODEGEN_UNITS=64 CARGO_PROFILE_RELEASE_DEBUG=false \
        CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target}/tools \
        cargo install -q --locked "cargo-deny@$version"
fi

advisories=passed
log=$(mktemp)
trap 'rm -f "$log"' EXIT
# The plants depend on a package as it would be published.
package=target/package/model-discrepancy-0.1.0
if [ ! -d "$package" ]; then
    cargo package -q --no-verify --allow-dirty -p model-core -p muscle-plant -p model-discrepancy \
        --target-dir target
    tar -xzf "$package.crate" -C target/package
fi
for workspace in . tests/board tests/fuzz tests/plants; do
    say "$workspace: licences, bans, sources"
    (cd "$workspace" && cargo deny --log-level error check --hide-inclusion-graph \
        licenses bans sources)
    if ! (cd "$workspace" && cargo deny check --hide-inclusion-graph advisories) >"$log" 2>&1; then
        if ! grep -q 'failed to fetch advisory database' "$log"; then
            cat "$log" >&2
            exit 1
        fi
        advisories=not-run
    fi
done
if [ "$advisories" = not-run ]; then
    say 'advisories: NOT RUN, their database cannot be reached from here'
    [ "$need_advisories" != --need-advisories ] || exit 1
fi
printf 'licences, bans, sources: passed; advisories: %s\n' "$advisories"
