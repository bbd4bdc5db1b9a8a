#!/usr/bin/env bash
# Makes the Debian packages, unpacks them into an empty root, and uses them from there as somebody who has nothing else of
# the project. Usage: check.sh BUILD_DIR SOURCE_DIR
set -euo pipefail
build=$1 source=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { echo "package: $*" >&2; exit 1; }

cpack -G DEB --config "$build/CPackConfig.cmake" -B "$work" >"$work/cpack.log" 2>&1 || { cat "$work/cpack.log" >&2; exit 1; }
deb=$(echo "$work"/viable_*_"$(dpkg --print-architecture)".deb)
library_deb=$(echo "$work"/libviable_*_"$(dpkg --print-architecture)".deb)
for file in "$deb" "$library_deb"; do
  [ -f "$file" ] || fail "no package came out: $(ls "$work")"
  if command -v lintian >/dev/null; then
    lintian --fail-on error,warning "$file" || fail "lintian has complaints (above)"
  fi
done
field() { dpkg-deb -f "${2:-$deb}" "$1"; }
expect_depends() {  # FILE PACKAGE...
  for package in "${@:2}"; do
    [[ "$(field Depends "$1")" == *"$package"* ]] || fail "$1: Depends lacks $package: $(field Depends "$1")"
  done
}
find_package_of() {  # LIBRARY: its package here; each Debian has another name for it
  local file
  file=$(realpath "/usr/lib/$(gcc -print-multiarch)/lib$1.so")
  dpkg -S "*/${file##*/}" | cut -d: -f1
}
yaml=$(find_package_of yaml-cpp) ldl=$(find_package_of ldl) amd=$(find_package_of amd)
expect_depends "$library_deb" libc6 libstdc++6 libsimbody3.7 "$yaml" libzstd1 zlib1g
expect_depends "$deb" libc6 libstdc++6 liblz4-1 "$ldl" "$amd" libssl3 libsqlite3-0 "libviable (= $(field Version))"
for name in viable lz4 ldl amd ssl sqlite hdf5 assimp; do
  [[ "$(field Depends "$library_deb")" != *"$name"* ]] || fail "libviable depends on $name: $(field Depends "$library_deb")"
done
[[ "$(field Recommends "$library_deb")" == *libeigen3-dev* ]] || fail "Recommends: $(field Recommends "$library_deb")"

root=$work/root
dpkg-deb -x "$library_deb" "$root"

# A loop of one's own, with the library's package alone.
loop=$work/loop
cp -r "$root/usr/share/viable/examples/own_loop" "$loop"
cmake -S "$loop" -B "$loop/build" -DCMAKE_PREFIX_PATH="$root/usr" >"$loop.log" && cmake --build "$loop/build" >>"$loop.log" ||
  { cat "$loop.log" >&2; exit 1; }
"$loop/build/own_loop" "$root/usr/share/viable/robots/indy7" 1 simulated_time >"$loop.log" || { cat "$loop.log" >&2; exit 1; }

dpkg-deb -x "$deb" "$root"
for package in viable libviable; do
  [ -s "$root/usr/share/doc/$package/copyright" ] || fail "no copyright file of $package"
done
find "$root" -type l ! -exec test -e {} \; -print | grep . && fail "these links lead nowhere"
paths=("$build")
if [ -z "$(cd "$root" && find . -path "*$source*" -print -quit)" ]; then
  paths+=("$source")
else  # a checkout in /viable: usr/lib/viable has it in its name, too
  echo "package: not looked for $source in the files, where it is part of names that belong there"
fi
for path in "${paths[@]}"; do
  ! grep -rlF -e "$path" "$root" || fail "these files (above) hold a path of the build: $path"
done
while read -r file; do
  runpath=$(readelf -d "$file" | sed -n 's/.*R\(UN\)\?PATH.*\[\(.*\)\]/\2/p')
  for entry in ${runpath//:/ }; do
    [[ "$entry" == '$ORIGIN'/* ]] || fail "$file looks for libraries in $entry"
  done
  ! readelf -S "$file" | grep -qF .symtab || fail "$file is not stripped"
done < <(find "$root/usr/bin" "$root/usr/lib" -type f \( -perm -u+x -o -name '*.so*' \))

viable=$root/usr/bin/viable
mkdir "$work/elsewhere"
cd "$work/elsewhere"  # nothing of the source tree in reach
unset VIABLE_PLUGIN_PATH VIABLE_ROBOT_PATH
experiment=$root/usr/share/viable/experiments/indy7_teleoperation.yaml
"$viable" run "$experiment" --out out --case C3 --set duration_s=0.5
[ -s out/C3.mcap ] && [ -s out/report.html ] || fail "the run left no log or report"
"$viable" schema >schema.json
cmp schema.json "$root/usr/share/viable/experiments/experiment.schema.json"

# A plugin of one's own: pass_through under another name.
mkdir own
sed 's/"pass_through"/"own_filter"/' "$source/plugins/filters/pass_through/PassThrough.cpp" >own/PassThrough.cpp
cp "$source/plugins/filters/pass_through/PassThrough.h" own/
cat >own/CMakeLists.txt <<EOF
cmake_minimum_required(VERSION 3.25)
project(own_filter CXX)
find_package(viable REQUIRED)
viable_add_plugin(own_filter KIND filter SOURCES PassThrough.cpp)
EOF
cmake -S own -B own/build -DCMAKE_PREFIX_PATH="$root/usr" >configure.log || { cat configure.log >&2; exit 1; }
grep -q "^viable_DIR:PATH=$root/" own/build/CMakeCache.txt || fail "CMake found another viable: $(grep ^viable_DIR own/build/CMakeCache.txt)"
cmake --build own/build >build.log || { cat build.log >&2; exit 1; }
export VIABLE_PLUGIN_PATH=$PWD/own/build/bin/plugins
"$viable" run "$experiment" --out own_out --case C1 --set duration_s=0.2 --set cases.C1.filter.plugin=own_filter

# The Python package beside it, where it is built.
python_deb=$(echo "$work"/python3-viable_*.deb)
if [ -f "$python_deb" ]; then
  depends=$(dpkg-deb -f "$python_deb" Depends)
  for package in "viable (= $(field Version))" python3-numpy "python3 (>= 3." "python3 (<< 3."; do
    [[ "$depends" == *"$package"* ]] || fail "python3-viable: Depends lacks $package: $depends"
  done
  dpkg-deb -x "$python_deb" "$root"
  for path in "${paths[@]}"; do
    ! grep -rlF -e "$path" "$root/usr/lib/python3" || fail "these files (above) hold a path of the build: $path"
  done
  [ -z "$(find "$root/usr/lib/python3" -type l)" ] || fail "the Python package holds links to the source tree"
  PYTHONPATH=$root/usr/lib/python3/dist-packages /usr/bin/python3 -B - "$root" "$experiment" <<'EOF'
import sys, viable
root, experiment = sys.argv[1:]
robot = viable.Robot("panda")
assert robot.folder.startswith(root) and viable.__file__.startswith(root) and viable._viable.library.startswith(root)
batch = viable.Batch(robot, 16, plant={"payload_kg": "~uniform(0, 1)"})
batch.step([[20.0] * 7] * 16)
assert viable.run(experiment, cases="C3", set={"duration_s": 0.2})["exit_code"] == 0
EOF
  # A plugin in Python, which the package without Python refuses with its remedy.
  cp "$root/usr/share/doc/python3-viable/examples/"my_law.* .
  "$viable" run my_law.yaml --out law_out --set duration_s=0.1
  find "$root/usr/lib" -name viable_python.so -exec mv {} "$work" \;
  ! "$viable" run my_law.yaml --out no_law_out 2>law.log || fail "a plugin in Python ran without its library"
  grep -q "python3-viable" law.log || fail "no remedy: $(cat law.log)"
  ! readelf -d "$viable" $(find "$root/usr/lib" -name 'libviable*.so*' -type f) | grep -q libpython || fail "the program itself needs Python"
  echo "package: $(basename "$python_deb"), $(stat -c %s "$python_deb") bytes, runs from there"
fi
for file in "$library_deb" "$deb"; do
  echo "package: $(basename "$file"), $(stat -c %s "$file") bytes, runs from an empty root"
done
