#!/bin/sh
# Installs the system packages that building Caustica needs, on Debian and its kin. A Rust toolchain is assumed.
# Embree and libclang serve the default ray backend only: `cargo build --no-default-features --features bvh` does
# without them.
set -eu

packages="gcc libc6-dev libembree-dev libclang-dev"

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
    echo "setup.sh: this is no Debian-like system; please install a C compiler, Embree 3.13 or newer and libclang," \
        "both with headers (here named: $packages)" >&2
    exit 1
fi

missing=""
for package in $packages; do
    status=$(dpkg-query -W -f='${Status}' "$package" 2>/dev/null) || true
    [ "$status" = "install ok installed" ] || missing="$missing $package"
done
[ -n "$missing" ] || exit 0

as_root=""
if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
        echo "setup.sh: please run as root: apt-get install -y$missing" >&2
        exit 1
    fi
    as_root="sudo"
fi
echo "setup.sh: installing$missing"
$as_root apt-get update -qq
# shellcheck disable=SC2086 # a list of words
$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing
