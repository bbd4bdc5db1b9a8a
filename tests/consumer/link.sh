#!/usr/bin/env bash
# viable_link.h by itself: it compiles as C99 and as C++17 without a warning, as does viable_link_linux.h; and the
# examples link_robot and link_skeletons, built as their READMEs say, are driven by `viable run`. Usage: link.sh BUILD_DIR SOURCE_DIR
set -euo pipefail
build=$1 source=$2
work=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null || true; rm -rf "$work"' EXIT
cd "$work"
include=$source/framework/include
warnings=(-Wall -Wextra -Wpedantic -Wconversion -Wshadow -Werror)
cat >use.c <<'END'
#include HEADER
int main(void) {
    vl_robot robot;
    vl_host host;
    vl_state state;
    double tau[VL_MAX_JOINTS];
    unsigned char packet[VL_MAX_PACKET];
    memset(&state, 0, sizeof state);
    vl_robot_init(&robot, 1, 0.001, 1);
    vl_host_init(&host, 1, 0.001, 2, 3);
    vl_robot_receive(&robot, packet, vl_host_command(&host, VL_HOLD, tau, 0, packet), 4);
    vl_robot_tick(&robot, tau);
    return vl_host_receive(&host, packet, vl_robot_state(&robot, &state, packet), 3, &state) == VL_GOOD ? 0 : 1;
}
END
cp use.c use.cpp
if grep '#include' "$include/viable/link/viable_link.h" | grep -Ev '<(stddef|stdint|string)\.h>'; then
  echo "link: viable_link.h needs more than the language's own headers"
  exit 1
fi
for header in viable_link viable_link_linux; do
  cc -std=c99 -O1 "${warnings[@]}" -Wstrict-prototypes -DHEADER="\"viable/link/$header.h\"" -I "$include" use.c -o use_c
  c++ -std=c++17 -O1 "${warnings[@]}" -DHEADER="\"viable/link/$header.h\"" -I "$include" use.cpp -o use_cpp
  ./use_c && ./use_cpp || { echo "link: host and robot do not understand each other"; exit 1; }
done
echo "link: compiles as C99 and C++17"

example=$source/framework/examples/link_robot
cc -std=c99 -O2 "${warnings[@]}" -I "$include" "$example/link_robot.c" -o link_robot
code=0
./link_robot nowhere 1 1 2>error.txt || code=$?
[ "$code" = 2 ] && grep -q 'link_robot: nowhere: an address is numeric' error.txt
address=shm:viable-example-$$
./link_robot "$address" 1 60 >robot.txt &
robot=$!
"$build/bin/viable" run "$example/experiment.yaml" --set "real_plant.address=$address" --set real_plant.repeat_ticks=100 \
  --set real_plant.silence_timeout_s=2 --set duration_s=1 --out run --no-report --details | tee run.txt
grep -q 'verdict *all limits kept (nominal arm' run.txt
kill -INT "$robot"
wait "$robot"
cat robot.txt
grep -Eq '^packets good: [1-9][0-9][0-9]' robot.txt

skeletons=$source/framework/examples/link_skeletons
for skeleton in callback fieldbus; do
  [ "$(wc -l <"$skeletons/$skeleton.c")" -le 80 ]
  cc -std=c99 -O2 "${warnings[@]}" -Wstrict-prototypes -I "$include" "$skeletons/$skeleton.c" -o "$skeleton" -lm
  c++ -x c++ -std=c++17 -O2 "${warnings[@]}" -I "$include" "$skeletons/$skeleton.c" -o "${skeleton}_cpp"
  for program in "$skeleton" "${skeleton}_cpp"; do
    address=shm:viable-$program-$$
    "./$program" "$address" 4 >"$program.txt" &
    robot=$!
    "$build/bin/viable" run "$example/experiment.yaml" --set "real_plant.address=$address" --set real_plant.repeat_ticks=100 \
      --set real_plant.silence_timeout_s=2 --set duration_s=0.5 --set 'start={position_rad: 0.7}' --out "run_$program" --no-report --details >"run_$program.txt"
    grep -q 'verdict *all limits kept (nominal arm' "run_$program.txt"
    wait "$robot"
    cat "$program.txt"
    grep -Eq 'good [1-9][0-9][0-9]' "$program.txt"
  done
done
echo "link: both skeletons are driven, in C and in C++"
