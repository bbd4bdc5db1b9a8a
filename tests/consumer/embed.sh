#!/usr/bin/env bash
# The guards inside a stranger's loop: installs the library alone into an empty prefix, builds the installed examples own_loop
# and reference_stream as their READMEs say, and runs them; link_robot is built here and run by link.sh. Then the program is
# installed beside it. Usage: embed.sh BUILD_DIR
set -euo pipefail
build=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
prefix="$work/prefix"
cmake --install "$build" --prefix "$prefix" --component library >"$work/install.log"
[ ! -e "$prefix/bin/viable" ] || { echo "embed: the library brings the program"; exit 1; }
cp -r "$prefix/share/viable/examples/"{own_loop,reference_stream} "$work/"
cd "$work"  # nothing of the source tree in reach
compile() {  # EXAMPLE FOLDER
  { cmake -S "$1" -B "$2" -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_CXX_FLAGS="-Wall -Wextra -Werror" &&
    cmake --build "$2"; } >build.log 2>&1 || { cat build.log; exit 1; }
}
compile own_loop build
compile reference_stream build_stream
# What an embedding program links to: the C and C++ libraries, and at most 11 of others.
needed=$(readelf -d "$(echo "$prefix"/lib*/libviable.so)" | sed -n 's/.*NEEDED.*\[\(.*\)\]/\1/p' |
  grep -Ev '^(libstdc\+\+|libm|libgcc_s|libc|ld-linux.*)\.so')
echo "embed: libviable needs" $needed
[ "$(wc -l <<<"$needed")" -le 11 ] || { echo "embed: libviable needs more than 11 libraries of others"; exit 1; }
cmake --install "$build" --prefix "$prefix" >>"$work/install.log"
cc -std=c99 -O2 -Wall -Wextra -Werror -I "$prefix/include" "$prefix/share/viable/examples/link_robot/link_robot.c" -o link_robot

expect_kept() {  # FILE: no limit was passed in a single tick
  [ "$(grep -c 'outside in 0 joint-ticks' "$1")" = 4 ] || { echo "embed: a limit was broken"; exit 1; }
}
expect_ended_well() {  # FILE CODE: until its end, or stopped for a reason that it names, as on a machine that stalls
  [ "$2" = 0 ] || { [ "$2" = 1 ] && grep -Eq '^stopped +[^ ]' "$1"; } || { echo "embed: exit code $2"; exit 1; }
}
echo "embed: 30 s of simulated time"
build/own_loop "$prefix/share/viable/robots/indy7" 30 simulated_time | tee simulated.txt
expect_kept simulated.txt
grep -q 'position  *worst use 100.00 %' simulated.txt  # the law did press against its limits
grep -Eq '^ticks .* 1[0-9][0-9] missed$' simulated.txt

robots=0
for robot in "$prefix"/share/viable/robots/*/; do
  echo "embed: 5 s of simulated time, $(basename "$robot")"
  build/own_loop "$robot" 5 simulated_time | tee robot.txt  # not stopped: its exit code is 0
  expect_kept robot.txt
  # Farther than largestDeviation, 100 mrad, would have stopped it; these are far from that.
  awk '/^real arm/ { seen = 1; if ($5 > 70) exit 1 } END { if (!seen) exit 1 }' robot.txt ||
    { echo "embed: the real arm strays"; exit 1; }
  robots=$((robots + 1))
done
[ "$robots" -ge 5 ]

echo "embed: a log, and what viable makes of it"
mkdir logs
build/own_loop "$prefix/share/viable/robots/indy7" 3 simulated_time logs/sway.mcap >logged.txt
expect_kept logged.txt
"$prefix/bin/viable" report logs
ls logs/*.html
code=0
build/own_loop "$prefix/share/viable/robots/indy7" 3 simulated_time logs/sway.mcap 2>error.txt || code=$?
[ "$code" = 2 ] && grep -q "own_loop: .*sway.mcap" error.txt  # never overwritten

echo "embed: 2 s by the clock"
code=0
build/own_loop "$prefix/share/viable/robots/indy7" 2 >clock.txt || code=$?
cat clock.txt
expect_kept clock.txt
expect_ended_well clock.txt "$code"

echo "embed: a robot that is not there"
code=0
build/own_loop "$work/no_robot" 1 2>error.txt || code=$?
cat error.txt
[ "$code" = 2 ] && grep -q "own_loop: .*no_robot" error.txt

echo "embed: targets at 30 Hz, every robot"
for robot in "$prefix"/share/viable/robots/*/; do
  build_stream/reference_stream "$robot" 20 trajectory.csv | tee stream.txt
  expect_kept stream.txt
  # About the way of a sample, 33 ms, at 0.3 of the speed limit; the limits of single_joint are as large as it is slow.
  most=25
  [ "$(basename "$robot")" != single_joint ] || most=100
  awk -v most=$most '/^reference/ { seen = 1; if ($2 > most) exit 1 } END { if (!seen) exit 1 }' stream.txt ||
    { echo "embed: the reference strays"; exit 1; }
  [ "$(wc -l <trajectory.csv)" -gt 20000 ]
done
