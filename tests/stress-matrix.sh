#!/usr/bin/env bash
# Traces every case of a folder of stress cases with every structure, every traversal and both kinds of planes of the
# kd-tree, and prints how many answers each gets wrong. For numbers by hand; `raybrook stress --methods` makes its own
# cases.
#
#   tests/stress-matrix.sh CHECK.py [OPTION of raybrook trace]...
#
# docs/record/2026-11-21-pocl-stress-cases.md has a run.
#
# CHECK.py traces its cases with `raybrook trace` (`CHECK.py --raybrook PATH -- OPTIONS`), prints its counts in the last
# line and ends with 0 when nothing is wrong. RAYBROOK names another binary than target/release/raybrook. Ends with 1
# when a method that promises exact hits is wrong; thesis-restart, which loses hits by design, is shown only.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
binary=${RAYBROOK:-$root/target/release/raybrook}
[[ $# -ge 1 && -f $1 ]] || { printf 'usage: %s CHECK.py [OPTION]...\n' "${BASH_SOURCE[0]}" >&2; exit 2; }
check=$1
shift

status=0
count_wrong() { # name, whether wrong answers count, options
    local name=$1 counts=$2 result
    shift 2
    if result=$(python3 "$check" --raybrook "$binary" -- "$@" 2>&1); then
        printf '%-24s %s\n' "$name" "${result##*$'\n'}"
    else
        [[ $counts = no ]] && result=${result##*$'\n'} || status=1
        printf '%-24s %s\n' "$name" "$result"
    fi
}

for build in sah median; do
    for traversal in stack restart push-down short-stack ropes; do
        count_wrong "kd $build $traversal" yes --structure kd --build "$build" --traversal "$traversal" "$@"
    done
    # As good as no stack at all: nearly every far child is forgotten.
    count_wrong "kd $build short-stack 1" yes --structure kd --build "$build" --traversal short-stack \
        --stack-size 1 "$@"
    count_wrong "kd $build thesis-restart" no --structure kd --build "$build" --traversal thesis-restart "$@"
done
for build in sampled-median spatial-median volume; do
    count_wrong "kd $build stack" yes --structure kd --build "$build" "$@"
done
for accel in brute bvh2 bvh8 grid octree boxes spheres; do
    count_wrong "$accel" yes --structure "$accel" "$@"
done
exit "$status"
