#!/usr/bin/env bash
# Runs the tests of bit-identity (device = Rust twin) on every OpenCL runtime for CPUs that can be had here, one runtime
# alone after the other, and prints a table. Installs what is missing on Debian and Ubuntu: PoCL, Oclgrind and Mesa's
# rusticl with apt, Intel's runtime from PyPI. What cannot be installed is left out with the reason; an installed
# runtime that disagrees, crashes or hangs fails the script.
#
#   tests/runtimes.sh                 all of them
#   tests/runtimes.sh intel rusticl   these
#
# RAYBROOK_INTEL_OPENCL names the folder (a Python environment, 0.8 GB) with Intel's runtime; default
# ~/.cache/raybrook-intel-opencl. OCLGRIND_DATA_RACES=0 and OCLGRIND_UNINITIALIZED=1: see ./test. A GPU's runtime is
# tested by hand: RAYBROOK_DEVICE=gpu cargo test.
#
# What the runtimes get wrong, and what stands against it:
#   Intel 2026.22   A function that is not inlined and takes a float3 sees the first lane's argument in all lanes of a
#                   work-group of 4 and more: __attribute__((noinline)) float f(float3 p) { return p.x + p.y; } called
#                   by a kernel. One lane for each vector instead, by an attribute (cl/shared/compiler.cl).
#                   (float)(int)x is -0 for x in -1..0; not used.
#                   -cl-fast-relaxed-math takes every NaN for a number: refused there (cl/shared/compiler.cl).
#                   Once in some ten runs of the tests, two at a time, its compiler did not end (it propagated constants
#                   for eight minutes): one test at a time, and a run that hangs is tried once more.
#   NVIDIA          -cl-fast-relaxed-math makes divisions inexact: refused there (cl/shared/compiler.cl).
#   rusticl 22.3.6  No double: the triangle test takes its float-only path. Flushes numbers below 1.2e-38 and drops the
#                   sign of some zeros (u, v of --intersector plucker; exact and watertight kept all bits). Whole traces
#                   with --intersector exact return hits that no triangle has, t = u = v = 0 (test
#                   the_closest_hit_is_the_exact_one; Mesa warns "Treating load_kernel_arg in control flow as uniform,
#                   results may be incorrect"), and compile for minutes: refused on llvmpipe (src/device/tracer.rs). Its
#                   compiler crashes on the mega-kernel. --kernels wavefront --intersector watertight rendered the
#                   reference's picture. So only functions are tested.
#   Oclgrind 21.10  Loses kernels that are launched from several threads, so one test at a time. Ignores #line. Crashes
#                   on some vector code with OCLGRIND_UNINITIALIZED.
#   PoCL 3.1        Contexts from several threads at once fail (src/device/mod.rs has a lock); processes must not share
#                   an empty cache.

ALL_RUNTIMES=(pocl intel oclgrind rusticl)
# Seconds for one test file on one runtime. Oclgrind interprets; the others need most of them for compilation.
TEST_LIMIT=${TEST_LIMIT:-900}
# Seconds for an installation.
INSTALL_LIMIT=300

heading() { printf '\n=== %s ===\n' "$1"; }
fail() { printf '%s: %s\n' "$0" "$1" >&2; exit 1; }

# A library that the dynamic linker knows by that name. The whole list is read: where a reader leaves early, who writes
# fails, and with it, where `pipefail` is set, the answer.
find_library() {
    { /sbin/ldconfig -p || ldconfig -p; } 2>/dev/null |
        awk -v name="$1" '$1 == name && !found { print $NF; found = 1 } END { exit !found }'
}

intel_folder() { printf '%s\n' "${RAYBROOK_INTEL_OPENCL:-${XDG_CACHE_HOME:-$HOME/.cache}/raybrook-intel-opencl}"; }

# The driver of a runtime, as an .icd file names it; fails where the runtime is not installed.
find_driver() {
    local file
    case $1 in
        pocl) find_library libpocl.so.2 ;;
        rusticl) find_library libRusticlOpenCL.so.1 ;;
        intel)
            file=$(intel_folder)/lib/libintelocl.so
            [[ -e $file ]] && printf '%s\n' "$file"
            ;;
        oclgrind)
            # Distributions and hand builds put it in different folders.
            for file in /usr/lib/oclgrind /usr/lib/*/oclgrind /usr/lib/* /usr/local/lib /usr/local/lib/oclgrind \
                /opt/oclgrind/lib; do
                file+=/liboclgrind-rt-icd.so
                if [[ -e $file ]]; then
                    printf '%s\n' "$file"
                    return
                fi
            done
            return 1
            ;;
    esac
}

apt_install() {
    command -v apt-get >/dev/null || { echo "there is no apt-get to install $* with" >&2; return 1; }
    local as_root=()
    if [[ $EUID -ne 0 ]]; then
        command -v sudo >/dev/null || { echo "run as root: apt-get install $*" >&2; return 1; }
        as_root=(sudo)
    fi
    ${as_root[@]+"${as_root[@]}"} apt-get update &&
        ${as_root[@]+"${as_root[@]}"} env DEBIAN_FRONTEND=noninteractive apt-get install -y "$@"
}

install_intel() {
    local folder
    folder=$(intel_folder)
    python3 -m venv "$folder" || { apt_install python3-venv && python3 -m venv "$folder"; } || return
    if ! timeout "$INSTALL_LIMIT" "$folder/bin/pip" install --quiet intel-opencl-rt intel-cmplr-lib-rt; then
        rm -rf "$folder" # half an installation is none
        return 1
    fi
}

# Installs a runtime and the loader.
install_runtime() {
    case $1 in
        pocl) apt_install ocl-icd-libopencl1 pocl-opencl-icd ;;
        oclgrind) apt_install ocl-icd-libopencl1 oclgrind ;;
        rusticl) apt_install ocl-icd-libopencl1 mesa-opencl-icd ;;
        intel) { find_library libOpenCL.so.1 >/dev/null || apt_install ocl-icd-libopencl1; } && install_intel ;;
    esac
}

# The tests that prove bit-identity on a runtime, as program:arguments, with commas between the arguments. Those of
# Oclgrind, which interprets, are small; of rusticl see above.
tests_of() {
    case $1 in
        oclgrind) printf '%s\n' device:--test-threads=1,kernels:: device:--test-threads=1,memory:: \
            pictures:--test-threads=1,shading:: \
            methods:--test-threads=1,packets::what_packets_leave_open,packets::a_small_picture \
            pictures:adaptive::short_lists ;;
        rusticl) printf '%s\n' device:kernels::the_exact_intersector pictures:shading::refraction ;;
        *) printf '%s\n' device:kernels:: methods:exact:: pictures:images:: device:memory:: device:compiler_options:: \
            methods:packets:: ;;
    esac
}

# Runs a command with one runtime as the only one. Needs the folder $scratch.
with_runtime() {
    local runtime=$1 vendors=$scratch/vendors-$1 driver
    shift
    driver=$(find_driver "$runtime") || return
    mkdir -p "$vendors" "$scratch/pocl"
    printf '%s\n' "$driver" >"$vendors/$runtime.icd"
    local -x OCL_ICD_VENDORS=$vendors RAYBROOK_DEVICE=0 RAYBROOK_REQUIRE_DEVICE=1
    local -x RAYBROOK_CACHE_DIR=$scratch/cache-$runtime
    # A cache of its own: PoCL 3.1 may abort when processes fill the same empty cache at once.
    local -x POCL_CACHE_DIR=$scratch/pocl
    case $runtime in
        intel) local -x LD_LIBRARY_PATH=${driver%/*}${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH} ;;
        rusticl) local -x RUSTICL_ENABLE=llvmpipe ;;
        oclgrind)
            local -x OCLGRIND_DATA_RACES=${OCLGRIND_DATA_RACES:-1} OCLGRIND_UNINITIALIZED=${OCLGRIND_UNINITIALIZED:-0}
            # It reports on standard error. Its own OCLGRIND_LOG is of no use here: each new OpenCL context empties that
            # file.
            unset OCLGRIND_LOG
            ;;
    esac
    "$@"
}

# A test program.
test_program() {
    cargo test --workspace --profile quick --locked --no-run --test "$1" 2>&1 |
        sed -n 's/^ *Executable .* (\(.*\))$/\1/p' | grep .
}

# Runs tests of one program on one runtime; its output is in $scratch/log. Prints the verdict.
run_test() {
    local runtime=$1 test=${2%%:*} arguments=() program status try tries=1
    [[ $2 == *:* ]] && IFS=, read -ra arguments <<<"${2#*:}"
    program=$(test_program "$test") || { echo 'does not build'; return 1; }
    [[ $runtime != intel ]] || { arguments+=(--test-threads=1); tries=2; }
    for ((try = tries; try > 0; try--)); do
        status=0
        with_runtime "$runtime" timeout --kill-after=10 "$TEST_LIMIT" "$program" ${arguments[@]+"${arguments[@]}"} \
            >"$scratch/log" 2>&1 </dev/null || status=$?
        [[ $status == 124 || $status == 137 ]] || break
    done
    local passed reports
    passed=$(sed -n 's/^test result: .* \([0-9]* passed\); \([0-9]* failed\).*/\1, \2/p' "$scratch/log")
    # Every report of Oclgrind has a line that names the kernel.
    reports=$(grep -c $'\tKernel: ' "$scratch/log" || true)
    case $status in
        124 | 137) echo "hangs: stopped after $TEST_LIMIT s" ;;
        0)
            if [[ $reports -gt 0 ]]; then
                echo "$reports reports on the kernels"
                return 1
            fi
            if [[ $passed != [1-9]* ]]; then
                echo 'FAILED (ran no test)'
                return 1
            fi
            echo "passed ($passed)"
            return
            ;;
        *) echo "FAILED (${passed:-crashed with status $status})" ;;
    esac
    return 1
}

# Runs the tests of a runtime, of which the second argument may name some, and adds lines to $scratch/table. Fails when
# one fails.
test_runtime() {
    local runtime=$1 tests=${2:-$(tests_of "$1")} test verdict failed=0
    heading "$runtime"
    if ! find_driver "$runtime" >/dev/null; then
        echo "Installing $runtime"
        install_runtime "$runtime" >"$scratch/install" 2>&1 || tail -n 3 "$scratch/install"
    fi
    if ! find_driver "$runtime" >/dev/null; then
        printf '%-10s %-44s %s\n' "$runtime" - 'not installed: see above' | tee -a "$scratch/table"
        return 0
    fi
    for test in $tests; do
        verdict=$(run_test "$runtime" "$test") || { failed=1; grep -vE '^test .* ok$' "$scratch/log" | tail -n 40; }
        printf '%-10s %-44s %s\n' "$runtime" "${test/--test-threads=1,/}" "$verdict" | tee -a "$scratch/table"
    done
    return $failed
}

main() {
    set -euo pipefail
    cd "$(dirname "${BASH_SOURCE[0]}")/.."
    scratch=$(mktemp -d)
    trap 'rm -rf "$scratch"' EXIT
    local runtimes=("$@") runtime failed=0
    [[ $# -gt 0 ]] || runtimes=("${ALL_RUNTIMES[@]}")
    for runtime in "${runtimes[@]}"; do
        [[ " ${ALL_RUNTIMES[*]} " == *" $runtime "* ]] || fail "no runtime '$runtime'; there are: ${ALL_RUNTIMES[*]}"
    done
    heading 'Building the tests'
    cargo test --workspace --profile quick --locked --no-run --test device --test methods --test pictures
    for runtime in "${runtimes[@]}"; do
        test_runtime "$runtime" || failed=1
    done
    heading 'Runtimes'
    cat "$scratch/table"
    [[ $failed -eq 0 ]] || fail 'a runtime disagrees, see above'
}

[[ ${BASH_SOURCE[0]} != "$0" ]] || main "$@"
