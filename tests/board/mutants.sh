#!/usr/bin/env bash
# Introduces one error at a time into the firmware and into what model-core does for it, and shows
# which test notices it. Prints each error with the first test that fails; fails if no test does.
# Needs the cross toolchain (scripts/setup-cross.sh).
#
#   mutants.sh              all errors
#   mutants.sh WORDS        only errors whose name contains WORDS
#   mutants.sh --part 3/8   every eighth error, from the third on
#   mutants.sh --check      none; only whether each still changes its file, without a toolchain
#
# Works on a copy of the working tree as it is at the start, and does not change it.
set -euo pipefail
cd "$(dirname "$0")/../.."
only='' part=1 parts=1 check=''
case ${1:-} in
--check) check=1 ;;
--part) IFS=/ read -r part parts <<<"${2:?--part 3/8}" ;;
*) only=${1:-} ;;
esac

# Everything is built in the first two; the tests are built once. The copy is elsewhere, as cargo reads
# the configuration of all folders above.
mutants_dir=${MUTANTS_TARGET_DIR:-$PWD/target/mutants}
tests_dir=${CARGO_TARGET_DIR:-$PWD/tests/board/target}
work=${TMPDIR:-/tmp}/firmware-mutants-$UID
target=thumbv7em-none-eabihf
number=0 tried=0 survivors=0
export RUST_BACKTRACE=0

original=$PWD
if [ -z "$check" ]; then
    scripts/require.sh mutants cargo git cc pkg-config libclang pip
    scripts/board-engine.sh
    original=$work/original
    rm -rf "$work"
    mkdir -p "$original"
    git ls-files -z --cached --others --exclude-standard |
        tar -c --null --ignore-failed-read -T - 2>/dev/null | tar -x -C "$original"
fi

# Copies the original to $work/tree.
fresh_copy() {
    rm -rf "$work/tree"
    cp -a "$original" "$work/tree"
}

build() { (cd "$work/tree" && CARGO_TARGET_DIR=$mutants_dir cargo firmware "$@") >"$work/log" 2>&1; }

# Builds the tests on the emulated board with the toolchain of the host, and prints their program. Not
# from the copy, for which all that they need would be built again. cargo names the program relative to
# the folder it runs in, where it lies below that.
build_tests() {
    cd tests/board
    CARGO_TARGET_DIR=$tests_dir env -u RUSTUP_TOOLCHAIN \
        cargo test --release --no-run --test firmware 2>&1 | tee "$work/log" |
        sed -n 's/^ *Executable .*(\(.*\))$/\1/p' | xargs -r realpath
}

# The tests on the emulated board whose name contains $1. A mutant may hang one.
passes_on_board() {
    FIRMWARE=$mutants_dir/$target/release/firmware \
        timeout 600 "$tests" --include-ignored --skip power_cuts --skip hundred_thousand --skip live:: \
        --skip converter:: "$@" >"$work/log" 2>&1
}

# Those whose name contains $1, on the board whose bridge has a converter of its own.
passes_on_converter() {
    build --no-default-features --features nucleo-f411re,ads1220 &&
        FIRMWARE=$mutants_dir/$target/release/firmware timeout 600 "$tests" --include-ignored "$@" \
            >"$work/log" 2>&1
}

# model-core's own tests whose name contains $1.
passes_on_pc() {
    (cd "$work/tree" && CARGO_TARGET_DIR=$mutants_dir \
        timeout 600 env -u RUSTUP_TOOLCHAIN cargo test -q -p model-core -- "$@") >"$work/log" 2>&1
}

# Whether the tests pass: first the one that is expected to fail, then the others.
passes() {
    local file=$1 expected=$2
    if [[ $file == model-core/* ]]; then
        passes_on_pc "$expected" && passes_on_pc && build && passes_on_board
    elif [[ $expected == converter::* ]]; then
        passes_on_converter "$expected" && passes_on_converter converter::
    else
        build && passes_on_board "$expected" && passes_on_board
    fi
}

# Names of the failed tests.
failed() { sed -n 's/^    \([a-z_:0-9]*\)$/\1/p' "$work/log" | sort -u; }

# Arguments: name, file, sed program that must change the file, name of the test for it.
mutant() {
    local name=$1 file=$2 program=$3 expected=$4
    [[ $name == *$only* ]] || return 0
    number=$((number + 1))
    # Of all, also of those that another part tries.
    local changed
    if ! changed=$(sed -E "$program" "$original/$file") || [ "$changed" = "$(<"$original/$file")" ]; then
        printf '%s: NOT APPLIED, %s has changed\n' "$name" "$file"
        tried=$((tried + 1)) survivors=$((survivors + 1))
        return
    fi
    [ -z "$check" ] && [ $((number % parts)) = $((part % parts)) ] || return 0
    tried=$((tried + 1))
    fresh_copy
    sed -i -E "$program" "$work/tree/$file"
    if passes "$file" "$expected"; then
        printf '%s: SURVIVED\n' "$name"
    elif grep -q '^error' "$work/log" && [ -z "$(failed)" ]; then
        printf '%s: DOES NOT COMPILE\n' "$name"
        grep -m 3 -A 5 '^error' "$work/log"
    else
        printf '%s: noticed by %s\n' "$name" "$(failed | grep -m 1 . || echo 'a test that hangs')"
        return
    fi
    survivors=$((survivors + 1))
}

if [ -n "$check" ]; then
    # shellcheck source=/dev/null
    . tests/board/mutants.list
    exit $((survivors > 0))
fi
tests=$(build_tests) # in a subshell, so that its folder is left again
fresh_copy
if [ ! -x "$tests" ] || ! build || ! passes_on_board; then
    echo 'the unchanged firmware fails its tests: no mutant was tried'
    tail -n 5 "$work/log"
    exit 1
fi
# shellcheck source=/dev/null
. tests/board/mutants.list
printf '%d of %d errors were noticed\n' $((tried - survivors)) "$tried"
[ "$survivors" = 0 ]
