#!/usr/bin/env bash
# Builds the fuzz targets with a nightly Rust and cargo-fuzz, and runs one after the other.
#
#   fuzz/run.sh [SECONDS [TARGET...]]      600 seconds each, and all targets, unless something else is said
#
# FUZZ_SEEDS names a folder of models whose small files are tried, too; FUZZ_PART=I/N takes every Nth target alone,
# from the Ith on. Prints a row for each target, and ends with 1 if one failed: the input lies in fuzz/artifacts/TARGET
# then.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

seconds=${1:-600}
shift || true
targets=("$@")
if [[ ${#targets[@]} -eq 0 ]]; then
    for file in targets/*.rs; do targets+=("$(basename "$file" .rs)"); done
fi
if [[ -n ${FUZZ_PART:-} ]]; then
    part=()
    for ((i = ${FUZZ_PART%/*} - 1; i < ${#targets[@]}; i += ${FUZZ_PART#*/})); do part+=("${targets[i]}"); done
    targets=("${part[@]}")
fi

# The versions of what the library depends on are those that it is tested with.
[[ Cargo.lock -nt ../Cargo.lock ]] || cp ../Cargo.lock .
# cargo-fuzz builds for what it was built for itself, which may be musl: no sanitizer has that.
host=$(rustc +nightly --print host-tuple)
cargo +nightly fuzz build --fuzz-dir . --target "$host" --target-dir target --codegen-units 16

# Most of the time would go into a disk.
[[ -n ${TMPDIR:-} || ! -d /dev/shm ]] || export TMPDIR=/dev/shm
# One thread, so that an input does the same each time.
# An allocation that is refused is no fault, but one that is large is.
export RAYON_NUM_THREADS=1 ASAN_OPTIONS=allocator_may_return_null=1:quarantine_size_mb=16
limits=(-rss_limit_mb=2048 -malloc_limit_mb=512 -timeout=20 -detect_leaks=0)

# Copies what FUZZ_SEEDS has for a target into a folder.
more_seeds() {
    local endings
    case $1 in
        gltf) endings='gltf glb' ;;
        threemf) endings=3mf ;;
        texture) endings='png jpg bmp tga' ;;
        obj | mtl | ply | stl | off | nff | toml | npz) endings=$1 ;;
        *) return 0 ;;
    esac
    local ending
    for ending in $endings; do
        find "$FUZZ_SEEDS" -name "*.$ending" -type f -size -64k -exec cp -t "$2" {} +
    done
}

failed=0
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
printf '%-18s %12s %9s  %s\n' target inputs branches result
for target in "${targets[@]}"; do
    mkdir -p "corpus/$target" "artifacts/$target" "$scratch/more"
    [[ -z ${FUZZ_SEEDS:-} ]] || more_seeds "$target" "$scratch/more"
    dictionary=()
    [[ ! -e dictionaries/$target.dict ]] || dictionary=("-dict=dictionaries/$target.dict")
    result=holds
    "target/$host/release/$target" "${limits[@]}" "${dictionary[@]}" \
        "-max_total_time=$seconds" "-artifact_prefix=artifacts/$target/" -print_final_stats=1 \
        "corpus/$target" "seeds/$target" "$scratch/more" >"$scratch/log" 2>&1 </dev/null || result=FAILS
    inputs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$scratch/log")
    branches=$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$scratch/log" | tail -n 1)
    printf '%-18s %12s %9s  %s\n' "$target" "${inputs:-?}" "${branches:-?}" "$result"
    if [[ $result != holds ]]; then
        failed=1
        told='panicked|ERROR|SUMMARY|artifact|^assertion|left:|right:'
        { grep -E "$told" -A 1 "$scratch/log" || tail -n 20 "$scratch/log"; } | head -n 20 >&2 || true
    fi
    rm -rf "$scratch/more"
done
exit "$failed"
