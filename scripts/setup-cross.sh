#!/usr/bin/env bash
# Makes `cargo build --target thumbv7em-none-eabihf` work here, then prints the line that later
# commands need (`export RUSTUP_TOOLCHAIN=...`). Idempotent; use:  eval "$(scripts/setup-cross.sh)"
#
#   CROSS_MODE=auto     rustup; Debian's packages where rustup cannot download (default)
#   CROSS_MODE=rustup   rustup only
#   CROSS_MODE=debian   Debian's packages only; nothing but apt downloads anything
#
# Debian ships the compiler and the sources of core, but no core for this target: debian mode
# builds it once (half a minute).
set -euo pipefail

target=thumbv7em-none-eabihf
mode=${CROSS_MODE:-auto}
link=debian-web
rust_root=/usr/lib/rustlib
library=$rust_root/src/rust/library
lld=$rust_root/x86_64-unknown-linux-gnu/bin/rust-lld
stamp=$rust_root/$target/lib/built-by.txt

say() { printf 'setup-cross: %s\n' "$*" >&2; }

# Runs a command as root; sudo only where needed.
as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }

apt_install() {
    as_root apt-get update -qq >&2
    as_root env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq --no-install-recommends "$@" >&2
}

has_core() {
    compgen -G "$(rustc "+$1" --print sysroot)/lib/rustlib/$target/lib/libcore-*.rlib" >/dev/null
}

done_with() {
    say "ready: $(rustc "+$1" --version)"
    printf 'export RUSTUP_TOOLCHAIN=%q\n' "$1"
    exit 0
}

rustup_route() {
    local toolchain
    # The toolchain in force here, never our own link to Debian's.
    toolchain=$(env -u RUSTUP_TOOLCHAIN rustup show active-toolchain | cut -d' ' -f1)
    if ! has_core "$toolchain"; then
        timeout "${CROSS_RUSTUP_TIMEOUT_S:-180}" \
            rustup target add --toolchain "$toolchain" "$target" >&2 || return 1
    fi
    done_with "$toolchain"
}

# Debian's rustc has no rust-lld: takes rustup's, or Debian's lld.
debian_linker() {
    local have
    [ -x "$lld" ] && return
    have=$(compgen -G \
        "${RUSTUP_HOME:-$HOME/.rustup}/toolchains/stable-*/lib/rustlib/*/bin/rust-lld" |
        head -n 1 || true)
    if [ -z "$have" ]; then
        command -v ld.lld >/dev/null || apt_install lld
        have=$(command -v ld.lld)
    fi
    say "linker: $have"
    as_root mkdir -p "$(dirname "$lld")"
    as_root ln -sfn "$have" "$lld"
}

# Builds core and alloc from Debian's sources with Debian's compiler: they must be of one version.
debian_core() {
    local want work lib
    want=$(/usr/bin/rustc --version --verbose)
    [ "$(cat "$stamp" 2>/dev/null)" = "$want" ] && return
    say "building core and alloc for $target, once"
    work=$(mktemp -d)
    mkdir "$work/src"
    echo '#![no_std]' >"$work/src/lib.rs"
    printf '%s\n' '[package]' 'name = "sysroot"' 'edition = "2021"' '[workspace]' \
        >"$work/Cargo.toml"
    # embed-bitcode: cargo turns it off, and the firmware's link-time optimisation needs it.
    (cd "$work" && env -u CARGO_ENCODED_RUSTFLAGS -u CARGO_BUILD_TARGET \
        RUSTC_BOOTSTRAP=1 CARGO_TARGET_DIR="$work/target" \
        RUSTFLAGS="-Cembed-bitcode=yes -Ccodegen-units=1 \
            --remap-path-prefix=$(readlink -f "$library")=/rustc/library" \
        cargo "+$link" build -q --release -Zbuild-std=core,alloc --target "$target" >&2)
    lib=$(dirname "$stamp")
    as_root mkdir -p "$lib"
    as_root find "$lib" -name '*.rlib' -delete
    as_root cp "$work/target/$target/release/deps"/lib{core,alloc,compiler_builtins}-*.rlib "$lib/"
    printf '%s\n' "$want" | as_root tee "$stamp" >/dev/null
    rm -rf "$work"
}

debian_route() {
    if ! [ -x /usr/bin/rustc ] || ! [ -x /usr/bin/cargo ] || ! [ -d "$library" ]; then
        apt_install rustc-web cargo-web rust-web-src rust-web-clippy rustfmt-web
    fi
    rustup toolchain list | grep -q "^$link\b" || rustup toolchain link "$link" /usr
    debian_linker
    debian_core
    has_core "$link"
    done_with "$link"
}

case $mode in
rustup) rustup_route || { say "rustup could not add $target"; exit 1; } ;;
debian) debian_route ;;
auto) rustup_route || { say "rustup could not add $target; Debian's packages"; debian_route; } ;;
*) say "CROSS_MODE: expected auto, rustup or debian"; exit 2 ;;
esac
