#!/usr/bin/env bash
# Set-up, then all tests. Usage: tools/test.sh [PRESET] [more arguments of ctest]
# PRESET: release (default), asan (memory and undefined behaviour), tsan (data races).
set -euo pipefail
cd "$(dirname "$0")/.."
preset=release
if [ $# -gt 0 ] && [[ "$1" != -* ]]; then
  preset=$1
  shift
fi
tools/setup.sh "$preset"
echo "test: running all tests of preset $preset"
exec ctest --preset "$preset" -j "$(nproc)" "$@"
