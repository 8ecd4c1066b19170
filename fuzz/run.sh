#!/usr/bin/env bash
# Fuzzes each target (all, if none is named) for SECONDS (1800) or ten million inputs. Ends non-zero on a finding: an
# input that panics, hangs for 5 s, or takes more than 1 GiB. Needs a C++ compiler and `cargo install cargo-fuzz`.
# Usage: fuzz/run.sh [SECONDS] [TARGET...]
set -euo pipefail
cd "$(dirname "$0")"

all=(xml obj mtl ply serialized image checkpoint render)
seconds=1800
if [[ "${1:-}" =~ ^[0-9]+$ ]]; then
    seconds="$1"
    shift
fi
targets=("$@")
[[ $# -gt 0 ]] || targets=("${all[@]}")

# The code under test has no unsafe without Embree: AddressSanitizer would only cost time, and a nightly compiler.
export CARGO_TARGET_DIR="$PWD/target"
cargo fuzz build --sanitizer none

# libFuzzer leaves without cleaning up.
parent="${TMPDIR:-/tmp}"
[[ -n "${TMPDIR:-}" || ! -w /dev/shm ]] || parent=/dev/shm
TMPDIR="$(mktemp -d "$parent/caustica-fuzz.XXXXXX")"
export TMPDIR
trap 'rm -rf "$TMPDIR"' EXIT

failed=()
for target in "${targets[@]}"; do
    # Pictures are rendered of the same scenes as are read.
    like="$target"
    [[ "$target" != render ]] || like=xml
    options=(-max_total_time="$seconds" -runs=10000000 -timeout=5 -rss_limit_mb=1024 -max_len=4096 -print_final_stats=1)
    [[ ! -f "$like.dict" ]] || options+=(-dict="$like.dict")
    mkdir -p "corpus/$target"
    printf '\n== fuzz %s\n' "$target" >&2
    cargo fuzz run --sanitizer none "$target" "corpus/$target" "seeds/$like" -- "${options[@]}" || failed+=("$target")
done

if [[ ${#failed[@]} -gt 0 ]]; then
    echo "error: findings in ${failed[*]}; the inputs are in fuzz/artifacts" >&2
    exit 1
fi
