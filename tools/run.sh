#!/usr/bin/env bash
# Set-up, then an experiment. Usage: tools/run.sh [EXPERIMENT.yaml] [more arguments of `viable run`]
set -euo pipefail
root="$(cd "$(dirname "$0")/.." && pwd)"
"$root/tools/setup.sh" release viable_app
experiment="$root/experiments/indy7_teleoperation.yaml"
if [ $# -gt 0 ] && [[ "$1" != -* ]]; then
  experiment=$1
  shift
fi
exec "$root/build/release/bin/viable" run "$experiment" "$@"
