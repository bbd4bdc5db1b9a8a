#!/usr/bin/env bash
# Installs the Debian packages that are missing, configures and builds. Usage: tools/setup.sh [PRESET [TARGET [arguments of cmake]]]
# PRESET is one of CMakePresets.json: release (default), debug, asan, tsan. TARGET: all (default), viable_app (program and
# plugins without the tests), viable_python (those and the Python package), viable_package (the Debian package) or another target of the build. Safe to run again: quick when there is nothing to do.
set -euo pipefail
cd "$(dirname "$0")/.."
preset=${1:-release}
target=${2:-all}

packages=(
  g++ cmake ninja-build pkg-config  # compiler and build
  mold                              # a faster linker
  libsimbody-dev                    # multibody dynamics
  libeigen3-dev                     # vectors and matrices
  libyaml-cpp-dev                   # YAML events for the strict configuration reader
  libtinyxml2-dev                   # robot descriptions (URDF): XML
  liburdfdom-dev                    # and what it says
  nlohmann-json3-dev                # summary.json
  libzstd-dev zlib1g-dev            # log compression and CRC
  liblz4-dev                        # chunks of other people's MCAP files
  libsuitesparse-dev                # LDL: banded systems of `viable verify`, normal equations of `viable identify`
  libhdf5-dev                       # export of logs as HDF5
  liboctomap-dev                    # maps of what stands around the arm
  libassimp-dev                     # mesh files for the replay
  nodejs npm esbuild                # bundle the pages of reports
  libcli11-dev                      # command line
  libsqlite3-dev                    # results of sweeps
  libssl-dev                        # HTTPS of the live page
  libboost-dev                      # Beast, headers only: server of the live page
  libqrencode-dev                   # its address for a phone, on the terminal
  libtbb-dev                        # runs of a sweep side by side
  libgtest-dev                      # tests
  libdynamicedt3d-dev               # benchmarks: another distance field to compare with
)
if [ "$target" = viable_bench ]; then
  packages+=(
    libbenchmark-dev                # benchmarks
    liborocos-kdl-dev libmujoco-dev # dynamics to compare with
    r-cran-quadprog                 # a QP solver to compare with
  )
fi
if [ "$target" = all ]; then
  packages+=(
    chromium                        # tests of the report
    python3-h5py python3-pandas     # tests of the HDF5 export
    libmujoco-dev                   # the real plant `mujoco`; an independent engine to compare robots with
    libopenmpi-dev openmpi-bin      # sweeps across machines
    python3-venv                    # test of `pip install`
    python3-jsonschema python3-yaml # tests of the schema of experiment files
    clang-format                    # the formatter whose opinion counts: tests/structure/format.sh
    git                             # test of compare_bench.sh
  )
fi
if [ "$target" = all ] || [ "$target" = viable_python ] || [ "$target" = viable_package ]; then
  packages+=(python3-dev pybind11-dev python3-numpy)  # the Python package; the module's compiler needs the first two
fi
if [ "$target" = all ] || [ "$target" = viable_interface ]; then
  packages+=(abigail-tools)         # layout of the plugin interface against the recorded one
fi
if [ "$target" = all ] || [ "$target" = viable_package ]; then
  packages+=(dpkg-dev file)         # dependencies of the Debian package
fi
missing=()
for package in "${packages[@]}"; do
  [ "$package" = npm ] && command -v npm >/dev/null && continue  # other builds of Node.js bring their own
  dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
done
if [ ${#missing[@]} -gt 0 ]; then
  echo "setup: installing ${missing[*]}"
  sudo=()
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || {
      echo "setup: not root and no sudo here; run as root: apt-get install ${missing[*]}" >&2
      exit 2
    }
    sudo=(sudo)
  fi
  "${sudo[@]}" apt-get update -qq
  "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
else
  echo "setup: all packages are installed"
fi

echo "setup: configuring (preset $preset)"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
cmake --preset "$preset" "${@:3}" >"$log" 2>&1 || { cat "$log" >&2; exit 1; }
echo "setup: building $target in build/$preset (some minutes the first time)"
quiet=()
[ -t 1 ] || quiet=(-- --quiet)
cmake --build --preset "$preset" --target "$target" "${quiet[@]}"
echo "setup: done, the program is build/$preset/bin/viable"
