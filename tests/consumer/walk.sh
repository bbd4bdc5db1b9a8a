#!/usr/bin/env bash
# Installs the package into an empty prefix, builds a stranger's plugin against it with a stock CMake build type,
# and runs an experiment with it. Usage: walk.sh BUILD_DIR SOURCE_DIR BUILD_TYPE
set -euo pipefail
build=$1 source=$2 type=$3
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cmake --install "$build" --prefix "$work/prefix" >"$work/install.log"
cp "$source/tests/consumer/"{CMakeLists.txt,HalfTorque.cpp} "$work/"
cmake -S "$work" -B "$work/build" -DCMAKE_BUILD_TYPE="$type" -DCMAKE_PREFIX_PATH="$work/prefix" >"$work/configure.log"
cmake --build "$work/build" >"$work/build.log"
cd "$work"  # nothing of the source tree in reach
export VIABLE_PLUGIN_PATH="$work/build/bin/plugins"
viable="$work/prefix/bin/viable"
"$viable" plugins --describe half_torque
"$viable" run "$work/prefix/share/viable/experiments/indy7_teleoperation.yaml" --out "$work/out" --case C1 \
  --set duration_s=1 --set cases.C1.filter.plugin=half_torque
test -s "$work/out/C1.mcap"
echo "walk: a plugin built in $type runs in the installed program"
