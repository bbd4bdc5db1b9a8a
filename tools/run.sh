#!/usr/bin/env bash
# Set-up, then an experiment. Usage: tools/run.sh [EXPERIMENT.yaml] [more arguments of `viable run`]
# or: tools/run.sh live [more arguments of `viable live`]: a simulated Indy7 on a page, to be moved by hand.
set -euo pipefail
root="$(cd "$(dirname "$0")/.." && pwd)"
"$root/tools/setup.sh" release viable_app
if [ "${1:-}" = live ]; then
  shift
  exec "$root/build/release/bin/viable" live "$root/experiments/indy7_live.yaml" --case tool "$@" --page
fi
experiment="$root/experiments/indy7_teleoperation.yaml"
if [ $# -gt 0 ] && [[ "$1" != -* ]]; then
  experiment=$1
  shift
fi
exec "$root/build/release/bin/viable" run "$experiment" "$@"
