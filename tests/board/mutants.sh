#!/usr/bin/env bash
# Introduces one error at a time into the firmware, and shows which tests on the emulated board
# fail. Needs the cross toolchain (scripts/setup-cross.sh). Prints each error and the tests that failed;
# fails if no test detects one. With an argument: only errors whose name contains it.
#
# Works on a copy of the last commit and does not change the working tree.
set -euo pipefail
cd "$(dirname "$0")/../.."
only=${1:-}
if [ -n "$(git status --porcelain -- firmware model-core hil-sim tests/board)" ]; then
    echo 'uncommitted changes: the mutants are made from the last commit, so commit first' >&2
    exit 2
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
# Target directories of the mutants and of the tests, which are built once.
firmware_dir=${MUTANTS_TARGET_DIR:-$PWD/target/mutants}
tests_dir=${CARGO_TARGET_DIR:-$PWD/tests/board/target}
target=thumbv7em-none-eabihf
survivors=0

# Copies the last commit to $work/tree.
fresh_copy() {
    rm -rf "$work/tree"
    mkdir "$work/tree"
    git archive HEAD | tar -x -C "$work/tree"
}

build() { (cd "$work/tree" && CARGO_TARGET_DIR=$firmware_dir cargo firmware) >"$work/log" 2>&1; }

# The tests are built with the toolchain of the host.
passes() {
    FIRMWARE=$firmware_dir/$target/release/firmware CARGO_TARGET_DIR=$tests_dir \
        env -u RUSTUP_TOOLCHAIN cargo test -q --release --manifest-path tests/board/Cargo.toml \
        --test firmware -- --include-ignored \
        --skip power_cuts --skip hundred_thousand >"$work/log" 2>&1
}

# Names of the failed tests.
failed() { sed -n 's/^    \([a-z]*::[a-z_0-9]*\)$/\1/p' "$work/log" | sort -u; }

# Arguments: name, file, sed program that must change the file.
mutant() {
    local name=$1 file=$2 program=$3
    [[ $name == *$only* ]] || return 0
    fresh_copy
    sed -i -E "$program" "$work/tree/$file"
    if git show "HEAD:$file" | cmp -s - "$work/tree/$file"; then
        printf '%s: NOT APPLIED, %s has changed\n' "$name" "$file"
    elif ! build; then
        printf '%s: DOES NOT COMPILE\n' "$name"
    elif passes; then
        printf '%s: SURVIVED\n' "$name"
    elif [ -z "$(failed)" ]; then
        printf '%s: NOT TESTED\n' "$name"
        tail -n 5 "$work/log"
    else
        printf '%s: caught by %d tests\n' "$name" "$(failed | wc -l)"
        failed | sed 's/^/    /'
        return
    fi
    survivors=$((survivors + 1))
}

fresh_copy
if ! build || ! passes; then
    echo 'the unchanged firmware fails its tests: no mutant was tried'
    tail -n 5 "$work/log"
    exit 1
fi

src=firmware/src
mutant 'encoder channels swapped' $src/driver/encoder.rs \
    's/(self\.0\.cnt\(\).*bits\(\))/\1.wrapping_neg()/'
mutant 'ADC channels wrong' $src/driver/adc.rs \
    's/configure_channel\(&bridge/configure_channel(\&X/; s/configure_channel\(&pressure/configure_channel(\&bridge/; s/configure_channel\(&X/configure_channel(\&pressure/'
mutant 'DAC not enabled' $src/driver/valve.rs 's/\.en1\(\)\.set_bit\(\)//'
mutant 'DAC buffer left on' $src/driver/valve.rs 's/\.boff1\(\)\.set_bit\(\)//'
mutant 'a crash does not set the valve to 0 V' $src/crash.rs 's/valve::make_safe\(\);//'
mutant 'watchdog not started' $src/driver/watchdog.rs \
    's/iwdg\.kr\(\)\.write\(\|w\| w\.key\(\)\.start\(\)\);//; s/while iwdg.*\{\}//'
mutant 'watchdog never fed' $src/main.rs 's/local\.watchdog\.feed\(\);//'
mutant 'tick at 11 ms' $src/driver/tick_timer.rs 's/TICK_COUNTS - 1/TICK_COUNTS + 999/'
mutant 'link task with the highest priority, blocking 12 ms' $src/main.rs \
    's/(binds = TIM3, priority = )2/\14/; s/(while let Some\(message\) = link\.receive\(\) \{)/\1 cortex_m::asm::delay(12 * 180_000);/'
mutant 'HSE without bypass' $src/board/nucleo_f446re.rs 's/\.bypass_hse_oscillator\(\)//'
mutant 'link at the wrong baud rate' $src/board/mod.rs 's/(LINK_BAUD: u32 = )921_600/\1460_800/'
[ "$survivors" = 0 ]
