#!/usr/bin/env bash
# Installs what the build needs on Debian and its relatives: the MuJoCo library with its headers, libclang
# (bindgen reads the headers with it), a C toolchain and pkg-config; with --render also OSMesa, with which
# pictures are drawn in software; with --plots also the Python packages of scripts/requirements.txt, into .venv at the
# root of the repository. Does nothing when all is there.
#
#   scripts/setup.sh [--render] [--plots]
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

packages=(libmujoco-dev libclang-dev build-essential pkg-config)
plots=false
for option in "$@"; do
    case "$option" in
        --render) packages+=(libosmesa6) ;;
        --plots) plots=true ;;
        *)
            echo "setup.sh: unknown option $option; there are --render and --plots" >&2
            exit 2
            ;;
    esac
done

if ! command -v dpkg >/dev/null || ! command -v apt-get >/dev/null; then
    echo "setup.sh: this is no Debian system; install MuJoCo, libclang, a C compiler and pkg-config yourself," >&2
    echo "          and set MUJOCO_DIR to the folder of MuJoCo if the build does not find it" >&2
    exit 1
fi

# Debian's Python comes without these two, others do not.
if $plots && ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
    packages+=(python3-venv)
fi

missing=()
for package in "${packages[@]}"; do
    # Captured first: with pipefail, `dpkg -s | grep -q` can fail although the line is there.
    status=$(dpkg -s "$package" 2>/dev/null || true)
    grep -q '^Status: install ok installed' <<<"$status" || missing+=("$package")
done

install_missing() {
    local as_root=()
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
}

make_venv() {
    if ! python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
        echo "setup.sh: the packages of scripts/requirements.txt need Python 3.11 or newer, $(python3 --version) is too old" >&2
        exit 1
    fi
    # Without pip it is what an interrupted attempt left.
    [[ -x $root/.venv/bin/pip ]] || python3 -m venv "$root/.venv"
    echo "setup.sh: Python packages for plots, in $root/.venv"
    "$root/.venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "$root/scripts/requirements.txt"
}

if ((${#missing[@]} == 0)); then
    echo "setup.sh: nothing to do, installed already: ${packages[*]}"
else
    install_missing
fi
if $plots; then
    make_venv
fi
echo "setup.sh: done"
