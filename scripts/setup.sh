#!/usr/bin/env bash
# Installs what the build needs on Debian and its relatives: the MuJoCo library with its headers, libclang
# (bindgen reads the headers with it), a C toolchain and pkg-config; with --render also OSMesa, with which
# pictures are drawn in software. Does nothing when all is there.
#
#   scripts/setup.sh [--render]
set -euo pipefail

packages=(libmujoco-dev libclang-dev build-essential pkg-config)
case "${1:-}" in
    "") ;;
    --render) packages+=(libosmesa6) ;;
    *)
        echo "setup.sh: unknown option $1; the only one is --render" >&2
        exit 2
        ;;
esac

if ! command -v dpkg >/dev/null || ! command -v apt-get >/dev/null; then
    echo "setup.sh: this is no Debian system; install MuJoCo, libclang, a C compiler and pkg-config yourself," >&2
    echo "          and set MUJOCO_DIR to the folder of MuJoCo if the build does not find it" >&2
    exit 1
fi

missing=()
for package in "${packages[@]}"; do
    # Captured first: with pipefail, `dpkg -s | grep -q` can fail although the line is there.
    status=$(dpkg -s "$package" 2>/dev/null || true)
    grep -q '^Status: install ok installed' <<<"$status" || missing+=("$package")
done

if ((${#missing[@]} == 0)); then
    echo "setup.sh: nothing to do, installed already: ${packages[*]}"
    exit 0
fi

as_root=()
if ((EUID != 0)); then
    if ! command -v sudo >/dev/null; then
        echo "setup.sh: missing ${missing[*]}; run this as root, or install sudo" >&2
        exit 1
    fi
    as_root=(sudo)
fi

echo "setup.sh: installing ${missing[*]}"
"${as_root[@]}" apt-get update
if ! "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends "${missing[@]}"; then
    echo "setup.sh: could not install ${missing[*]}; libmujoco-dev needs Debian 12 or newer" >&2
    exit 1
fi
echo "setup.sh: done"
