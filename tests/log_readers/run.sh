#!/usr/bin/env bash
# Writes short logs with the built program and has others read them.
# Usage: run.sh mcap|hdf5 BUILD SOURCE [FOLDER of the npm packages]. Exit code 77: a reader is not installed.
set -euo pipefail
what=$1 build=$2 source=$3 packages=${4:-}
here=$source/tests/log_readers
# Debian's own interpreter has Debian's h5py, whichever comes first in PATH.
python=${VIABLE_PYTHON:-/usr/bin/python3}
viable=$build/bin/viable

if [ "$what" = hdf5 ] && ! "$python" -c 'import h5py, numpy' 2>/dev/null; then
  echo "skipped: h5py and numpy are not installed for $python (Debian: apt-get install python3-h5py)"
  exit 77
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$source"
unset VIABLE_PLUGIN_PATH VIABLE_ROBOT_PATH
"$viable" run "$here/short.yaml" --out "$work/run" --no-report >"$work/out"

# Fails unless the command is refused: a reader that takes everything proves nothing.
refused() {
  if "$@" >"$work/out" 2>&1; then
    echo "accepted: $*" >&2
    return 1
  fi
  tail -n 1 "$work/out"
}

# A copy of which one byte, in its first compressed chunk, is another.
flip() {
  local at byte
  at=$(($(grep -abom 1 zstd "$1" | head -n 1 | cut -d : -f 1) + 1000))
  byte=$(od -A n -t u1 -j $at -N 1 "$1")
  cp "$1" "$2"
  printf "\\x$(printf %02x $((byte ^ 255)))" | dd of="$2" bs=1 seek=$at conv=notrunc status=none
}

# The log of a run that was killed: the first 60 % of the bytes.
cut_off() {
  head -c $(($(stat -c %s "$1") * 6 / 10)) "$1" >"$2"
}

if [ "$what" = mcap ]; then
  export VIABLE_LOG_READERS=$packages
  for log in tool joint; do
    node "$here/read_mcap.mjs" "$work/run/$log.mcap"
    cut_off "$work/run/$log.mcap" "$work/$log.mcap"
    refused node "$here/read_mcap.mjs" "$work/$log.mcap"
    "$viable" recover "$work/$log.mcap"
    node "$here/read_mcap.mjs" "$work/$log.recovered.mcap" | tail -n 1

    "$viable" export "$work/run/$log.mcap" --to mcap "$work/$log.again.mcap"
    node "$here/read_mcap.mjs" "$work/$log.again.mcap" | tail -n 1
    for one in run/$log $log.again; do
      "$viable" export "$work/$one.mcap" --to csv "$work/$one.csv"
    done
    cmp "$work/run/$log.csv" "$work/$log.again.csv"
    flip "$work/run/$log.mcap" "$work/flipped.mcap"
    refused node "$here/read_mcap.mjs" "$work/flipped.mcap"
  done
else
  for log in tool joint; do
    cut_off "$work/run/$log.mcap" "$work/$log-cut.mcap"
    cp "$work/run/$log.mcap" "$work/$log.mcap"
    for one in $log $log-cut; do
      "$viable" export "$work/$one.mcap" --to csv "$work/$one.csv"
      "$viable" export "$work/$one.mcap" --to hdf5 "$work/$one.h5"
      "$python" "$here/read_hdf5.py" "$work/$one.h5" "$work/$one.csv"
    done
    refused "$python" "$here/read_hdf5.py" "$work/$log-cut.h5" "$work/$log.csv"
    # One number
    awk -F, -v OFS=, 'NR == 300 { $4 = $4 + 1 } { print }' "$work/$log.csv" >"$work/changed.csv"
    refused "$python" "$here/read_hdf5.py" "$work/$log.h5" "$work/changed.csv"
  done
fi
