#!/usr/bin/env bash
# Builds the wheels and the source distribution of the Python package, and checks them.
#
#     packaging/wheels.sh [--out FOLDER] [PART...]
#
# Parts: x86_64, aarch64 (wheels for these processors), sdist (the source distribution), try (installs the wheel of this
# machine's processor in a new environment, and asks it for a picture and a batch of rays). Without any: all of them.
# FOLDER: target/wheels. Needs Rust, Python 3.10 with venv, and PyPI. Zig links with an old glibc, so that wheels run on
# every Linux of the last ten years; it links for other processors, too.
set -euo pipefail
cd "$(dirname "$0")/.."

MANYLINUX=manylinux2014
out=target/wheels
parts=()
while (($#)); do
    case $1 in
        --out) out=${2:?"--out: a folder is missing"} && shift ;;
        x86_64 | aarch64 | sdist | try) parts+=("$1") ;;
        *) printf "wheels.sh: '%s' is no part; possible: x86_64, aarch64, sdist, try\n" "$1" >&2 && exit 2 ;;
    esac
    shift
done
((${#parts[@]})) || parts=(x86_64 aarch64 sdist try)
mkdir -p "$out"
out=$(realpath "$out")
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# What builds and what checks, in an environment of its own.
tools() {
    [[ ! -e $scratch/tools ]] || return 0
    python3 -m venv "$scratch/tools"
    "$scratch/tools/bin/pip" install --quiet 'maturin[zig]>=1.9.4,<2' 'auditwheel>=6'
    PATH=$scratch/tools/bin:$PATH
}

version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)

fail() {
    printf 'wheels.sh: %s\n' "$1" >&2
    exit 1
}

wheel() {
    local architecture=$1 target=$1-unknown-linux-gnu wheel report
    ! command -v rustup >/dev/null || rustup target add "$target" 2>/dev/null || fail "rustup has no Rust for $target"
    maturin build --release --zig --compatibility "$MANYLINUX" --target "$target" --out "$out"
    wheel=$(echo "$out"/raybrook-"$version"-cp310-abi3-manylinux*_"$architecture".whl)
    [[ -e $wheel ]] || fail "there is no wheel of version $version for $architecture, for all Pythons from 3.10 on"
    report=$(auditwheel show "$wheel" 2>&1)
    printf '%s\n' "$report"
    grep -qF "platform tag: \"manylinux_2_17_$architecture\"" <<<"${report//$'\n'/ }" ||
        fail "$wheel wants a newer glibc than 2.17"
    # OpenCL is looked for when it runs, and Python is there then.
    ! grep -qiE 'opencl|libpython' <<<"$report" || fail "$wheel is linked with OpenCL or Python"
}

sdist() {
    maturin sdist --out "$out"
    [[ -e $out/raybrook-$version.tar.gz ]] || fail "there is no source distribution of version $version"
    # The folders that Cargo.toml names must be in it, or nothing can be built of it.
    tar -xzf "$out/raybrook-$version.tar.gz" -C "$scratch"
    cargo metadata --locked --no-deps --format-version 1 \
        --manifest-path "$scratch/raybrook-$version/Cargo.toml" >/dev/null
}

# As a user has it: of all that is here the new environment sees the wheel alone.
try_wheel() {
    python3 -m venv "$scratch/user"
    "$scratch/user/bin/pip" install --quiet "$out"/raybrook-"$version"-cp310-abi3-manylinux*_"$(uname -m)".whl
    cp packaging/try_wheel.py scenes/vase.obj "$scratch"
    (cd "$scratch" && env -u PYTHONPATH "$scratch/user/bin/python" try_wheel.py "$version")
}

for part in "${parts[@]}"; do
    case $part in
        x86_64 | aarch64)
            tools
            wheel "$part"
            ;;
        sdist)
            tools
            sdist
            ;;
        try) try_wheel ;;
    esac
done
ls -l "$out"
