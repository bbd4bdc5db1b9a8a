#!/usr/bin/env bash
# A stranger's walk: installs the package into an empty prefix, has the installed `viable new` write projects and a robot
# in an empty folder, builds and tests them there with a stock CMake build type (Release defines NDEBUG), and runs their
# experiments. Prints how long each part took. Usage: walk.sh BUILD_DIR BUILD_TYPE KIND...
# KIND: filter, controller, robust_loop, command, plant.
set -euo pipefail
build=$1 type=$2
shift 2
kinds=("$@")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
unset VIABLE_PLUGIN_PATH VIABLE_ROBOT_PATH

# part NAME COMMAND...: runs it, its output only where it fails; says how long it took.
part() {
  local name=$1 begin=$EPOCHREALTIME
  shift
  "$@" >"$work/log" 2>&1 || { echo "walk: $name failed: $*"; cat "$work/log"; exit 1; }
  awk -v name="$name" -v a="$begin" -v b="$EPOCHREALTIME" 'BEGIN { printf "walk: %6.1f s  %s\n", b - a, name }'
}
start=$EPOCHREALTIME

part "install" cmake --install "$build" --prefix "$work/prefix"
export PATH="$work/prefix/bin:$PATH"
mkdir "$work/empty"
cd "$work/empty"  # nothing of the source tree in reach

# A robot from a URDF: refused until its blanks are filled in, then it runs.
part "viable new robot" viable new robot my_arm --urdf "$work/prefix/share/viable/robots/planar_two_link/planar_two_link.urdf"
for file in limits actuation; do
  if viable robots --describe ./my_arm >"$work/log" 2>&1 || ! grep -q "$file.yaml:[0-9]*:[0-9]*: .*not filled in yet" "$work/log"; then
    echo "walk: a blank in $file.yaml was not refused by its place:"
    cat "$work/log"
    exit 1
  fi
  sed -i -e 's/^acceleration_radps2: TODO/acceleration_radps2: [20, 30]/' -e 's/^jerk_radps3: TODO/jerk_radps3: [300, 500]/' \
    -e 's/^gear_ratio: TODO/gear_ratio: 1/' -e 's/_kgm2: TODO/_kgm2: 0/' -e 's/_Nm: TODO/_Nm: 0.5/' \
    -e 's/_radps: TODO/_radps: 1/' "my_arm/$file.yaml"
done
part "describe the robot" viable robots --describe ./my_arm
part "its first run" viable run my_arm/first_run.yaml --out robot_out
grep -q '"verdict": "all limits kept' robot_out/summary.json
test -s robot_out/report.html

# One project per kind, built as its README says.
for kind in "${kinds[@]}"; do
  part "viable new $kind" viable new "$kind" "my_$kind"
  part "configure $kind" cmake -S "my_$kind" -B "my_$kind/build" -DCMAKE_BUILD_TYPE="$type" -DCMAKE_PREFIX_PATH="$work/prefix"
  part "build $kind ($type)" cmake --build "my_$kind/build" --parallel 2
  part "test $kind" ctest --test-dir "my_$kind/build" --output-on-failure --no-tests=error
  grep -q "my_${kind}_contract_test.*Passed" "$work/log"
  part "its contract" viable_contract "my_$kind/build/bin/plugins" "$kind" "my_$kind"
  grep -q "OK.*Contract.NeverPutsOutNan.*my_$kind" "$work/log"
  VIABLE_PLUGIN_PATH="$PWD/my_$kind/build/bin/plugins" \
    part "run $kind" viable run "my_$kind/experiment.yaml" --set duration_s=2 --out "out_$kind"
  test -s "out_$kind/report.html"
  if [ "$kind" = filter ]; then  # what is new works together
    VIABLE_PLUGIN_PATH="$PWD/my_filter/build/bin/plugins" part "the new filter on the new robot" \
      viable run my_arm/first_run.yaml --details --set 'cases.free.filter={plugin: my_filter}' --out out_both
    grep -q "^free: filter my_filter" "$work/log"
  fi
done
awk -v a="$start" -v b="$EPOCHREALTIME" -v type="$type" -v kinds="${kinds[*]}" \
  'BEGIN { printf "walk: %6.1f s  in all: a robot and %s, in %s\n", b - a, kinds, type }'
