#!/usr/bin/env bash
# Set-up, then tests. Usage: tools/test.sh [WHICH] [more arguments of ctest]
# WHICH: release (default; all suites, but what is nightly), asan (memory and undefined behaviour, with less effort and without
# the tests labelled "long"), tsan (data races: one program of what has threads), ci (release without what asan runs as well),
# nightly (all that there is: release with the long tests in real time, then all of asan, then tsan; best on an idle machine).
# tests/README.md says what runs where, and how to try harder.
set -euo pipefail
cd "$(dirname "$0")/.."
which=release
if [ $# -gt 0 ] && [[ "$1" != -* ]]; then
  which=$1
  shift
fi
# run PRESET TARGET TEST_PRESET SUITES [ctest's arguments...]
run() {
  tools/setup.sh "$1" "$2" -D VIABLE_TESTS="$4" &&
    echo "test: running the tests of $which, preset $1" &&
    ctest --preset "$3" -j "$(nproc)" --no-label-summary "${@:5}"
}
case "$which" in
  release) run release all release all "$@" ;;
  ci) run release all ci ci "$@" ;;
  asan) run asan all asan ci "$@" ;;
  tsan) run tsan threads_test tsan all "$@" ;;
  nightly)
    failed=()
    run release all nightly all "$@" || failed+=(release)
    run asan all asan all "$@" || failed+=(asan)
    run tsan threads_test tsan all "$@" || failed+=(tsan)
    [ ${#failed[@]} -eq 0 ] || { echo "test: failed: ${failed[*]}" >&2; exit 1; }
    ;;
  *)
    echo "test: '$which' is none of release, ci, asan, tsan, nightly" >&2
    exit 2
    ;;
esac
