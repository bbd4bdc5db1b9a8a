#!/usr/bin/env bash
# Set-up, then all tests. Usage: tools/test.sh [PRESET] [more arguments of ctest]
# PRESET: release (default), asan (memory and undefined behaviour; without the longest numerical ones), tsan (data races; only
# the framework's suites that have threads, without their longest tests of one thread).
set -euo pipefail
cd "$(dirname "$0")/.."
preset=release
if [ $# -gt 0 ] && [[ "$1" != -* ]]; then
  preset=$1
  shift
fi
target=all
if [ "$preset" = tsan ]; then
  target=viable_threaded_tests
fi
tools/setup.sh "$preset" "$target"
echo "test: running all tests of preset $preset"
exec ctest --preset "$preset" -j "$(nproc)" "$@"
