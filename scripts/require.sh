#!/usr/bin/env bash
# Ends with exit status 2 and one list if something is missing that a script needs: what, and the
# command that installs it.
#
#   require.sh SCRIPT NAME...       a NAME is a program's, or libclang, or pip
set -euo pipefail
script=$1
shift

# bindgen loads it.
has_libclang() {
    [ "$(uname)" != Linux ] || [ -n "${LIBCLANG_PATH:-}" ] ||
        compgen -G '/usr/lib*/libclang*.so*' >/dev/null ||
        compgen -G '/usr/lib*/*/libclang*.so*' >/dev/null ||
        compgen -G '/usr/lib*/*/lib*/libclang*.so*' >/dev/null
}

has() {
    case $1 in
    libclang) has_libclang ;;
    pip) python3 -m pip --version ;;
    *) command -v "$1" ;;
    esac >/dev/null 2>&1
}

missing=() packages=() rust=''
for name in "$@"; do
    if has "$name"; then continue; fi
    missing+=("$name")
    case $name in
    rustup | cargo) rust=1 ;;
    cc) packages+=(build-essential) ;;
    libclang) packages+=(libclang-dev) ;;
    pip) packages+=(python3-pip) ;;
    size) packages+=(binutils) ;;
    *) packages+=("$name") ;;
    esac
done
if [ ${#missing[@]} = 0 ]; then exit; fi
printf '%s: missing: %s\n' "$script" "${missing[*]}" >&2
if [ -n "$rust" ]; then
    printf '%s: rustup brings cargo: https://rustup.rs\n' "$script" >&2
fi
if [ ${#packages[@]} -gt 0 ]; then
    printf '%s: on Debian and Ubuntu: sudo apt install %s\n' "$script" "${packages[*]}" >&2
fi
exit 2
