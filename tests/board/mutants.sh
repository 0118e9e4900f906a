#!/usr/bin/env bash
# Breaks the firmware in one place at a time, and shows that the tests on the emulated board notice.
# Needs the cross toolchain (scripts/setup-cross.sh). Prints one line a mutant; fails if one lives.
# With an argument: only mutants whose name contains it.
set -euo pipefail
cd "$(dirname "$0")/../.."
only=${1:-}

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# The mutants' own place, and the tests', which are built once.
firmware_dir=${MUTANTS_TARGET_DIR:-$PWD/target/mutants}
tests_dir=${CARGO_TARGET_DIR:-$PWD/tests/board/target}
target=thumbv7em-none-eabihf
survivors=0

# name, file, then a program for sed that must change the file
mutant() {
    local name=$1 file=$2 program=$3 verdict
    [[ $name == *$only* ]] || return 0
    rm -rf "$work/tree"
    mkdir "$work/tree"
    git archive HEAD | tar -x -C "$work/tree"
    sed -i -E "$program" "$work/tree/$file"
    if git diff --quiet --no-index "$file" "$work/tree/$file"; then
        printf '%-44s NOT APPLIED: %s has changed\n' "$name" "$file"
        survivors=$((survivors + 1))
        return
    fi
    if ! (cd "$work/tree" && CARGO_TARGET_DIR=$firmware_dir cargo firmware) 2>"$work/log"; then
        verdict='caught: does not compile'
    elif FIRMWARE=$firmware_dir/$target/release/firmware CARGO_TARGET_DIR=$tests_dir \
        cargo test -q --release --manifest-path tests/board/Cargo.toml \
        --test firmware -- --skip power_cuts --skip hundred_thousand >"$work/log" 2>&1; then
        verdict='SURVIVED'
        survivors=$((survivors + 1))
    else
        verdict="caught by $(sort -u "$work/log" | grep -c '^    [a-z]*::[a-z_0-9]*$' || true) tests"
    fi
    printf '%-44s %s\n' "$name" "$verdict"
}

src=firmware/src
mutant 'encoder counts the other way' $src/encoder.rs 's/self\.0\.count\(\)/self.0.count().wrapping_neg()/'
mutant 'ADC channels exchanged' $src/adc.rs \
    's/configure_channel\(&bridge/configure_channel(\&X/; s/configure_channel\(&pressure/configure_channel(\&bridge/; s/configure_channel\(&X/configure_channel(\&pressure/'
mutant 'DAC not enabled' $src/valve.rs 's/\.en1\(\)\.set_bit\(\)//'
mutant 'DAC buffer left on' $src/valve.rs 's/\.boff1\(\)\.set_bit\(\)//'
mutant 'watchdog not started' $src/watchdog.rs 's/iwdg\.kr\(\)\.write\(\|w\| w\.key\(\)\.start\(\)\);//; s/while iwdg.*\{\}//'
mutant 'watchdog never fed' $src/main.rs 's/local\.watchdog\.feed\(\);//'
mutant 'tick at 11 ms' $src/adc.rs 's/TICK_COUNTS - 1/TICK_COUNTS + 999/'
mutant '12 ms blocked above the tick' $src/main.rs \
    's/(binds = TIM3, priority = )2/\14/; s/(while let Some\(message\) = link\.receive\(\) \{)/\1 cortex_m::asm::delay(12 * 180_000);/'
mutant 'HSE without bypass' $src/board/nucleo_f446re.rs 's/\.bypass_hse_oscillator\(\)//'
mutant 'link at the wrong speed' $src/board.rs 's/(LINK_BAUD: u32 = )921_600/\1460_800/'
[ "$survivors" = 0 ]
