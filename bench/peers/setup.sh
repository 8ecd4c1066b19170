#!/bin/sh
# Makes a virtualenv with the renderers that pip has, and LLVM for Mitsuba's llvm variants. May be run again.
set -eu
directory=${1:?usage: bench/peers/setup.sh DIRECTORY}

[ -x "$directory/bin/python" ] || python3 -m venv "$directory"
"$directory/bin/pip" install --quiet mitsuba pyluxcore numpy pyoidn

# Older ones, which a system may have too, are not enough.
if ! ls /usr/lib/*/libLLVM* /usr/lib/llvm-*/lib/libLLVM* 2>/dev/null | grep -Eq 'libLLVM(-|\.so\.)(1[7-9]|[2-9][0-9])'; then
    if [ "$(id -u)" = 0 ]; then
        apt-get update && apt-get install --yes libllvm19
    else
        echo "for mitsuba's llvm variants: apt-get install libllvm19" >&2
    fi
fi
