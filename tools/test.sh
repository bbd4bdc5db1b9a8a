#!/usr/bin/env bash
# Set-up, then all tests. Usage: tools/test.sh [PRESET] [more arguments of ctest]
# PRESET: release (default), asan (memory and undefined behaviour, with less effort and without the tests labelled "long"),
# tsan (data races: one program of what has threads). tests/README.md says what runs where, and how to try harder.
set -euo pipefail
cd "$(dirname "$0")/.."
preset=release
if [ $# -gt 0 ] && [[ "$1" != -* ]]; then
  preset=$1
  shift
fi
target=all
if [ "$preset" = tsan ]; then
  target=threads_test
fi
tools/setup.sh "$preset" "$target"
echo "test: running all tests of preset $preset"
exec ctest --preset "$preset" -j "$(nproc)" --no-label-summary "$@"
