#!/usr/bin/env bash
# Set-up, then the benchmarks: times, and their ratios to one Cholesky solve of the same size in the same run.
# Usage: tools/scripts/bench.sh [arguments of Google Benchmark], e.g. tools/scripts/bench.sh --benchmark_filter='n:6(/|$)'
set -euo pipefail
root="$(cd "$(dirname "$0")/../.." && pwd)"
"$root/tools/setup.sh" release viable_bench
echo "bench: a warning that the library was built as DEBUG is about Debian's Google Benchmark, not about what is measured"
# Repetitions in random order, so that a slow moment of the machine does not fall on one benchmark alone.
exec "$root/build/release/tests/viable_bench" --benchmark_min_time=0.02 --benchmark_repetitions=15 \
  --benchmark_enable_random_interleaving=true "$@"
