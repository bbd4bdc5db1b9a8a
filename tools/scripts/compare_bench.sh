#!/usr/bin/env bash
# Builds two commits and says which benchmarks became slower or faster by more than noise.
# Usage: tools/scripts/compare_bench.sh OLD NEW [--rounds COUNT] [--filter REGEX]
# OLD and NEW are commits, such as HEAD~1 and HEAD. Each is checked out and built in build/compare/COMMIT, which stays: a
# second comparison with the same commit builds nothing. The rule of the judgement: compare_bench.py.
# Exit code: 0 nothing is slower, 1 something is, 2 it could not be told.
set -euo pipefail
if [ $# -lt 2 ]; then
  sed -n '2,6s/^# //p' "$0" >&2
  exit 2
fi
root="$(cd "$(dirname "$0")/../.." && pwd)"
cd "$root"
programs=()
for name in "$1" "$2"; do
  commit=$(git rev-parse --verify --quiet "$name^{commit}") || {
    echo "compare_bench: '$name' is no commit" >&2
    exit 2
  }
  tree=$root/build/compare/$commit
  if [ ! -e "$tree/.git" ]; then
    git worktree prune
    git worktree add --quiet --detach "$tree" "$commit"
  fi
  echo "compare_bench: building $name ($commit)"
  "$tree/tools/setup.sh" release viable_bench >"$tree.log" 2>&1 || {
    tail -n 20 "$tree.log" >&2
    echo "compare_bench: $name cannot be built; all of it: $tree.log" >&2
    exit 2
  }
  programs+=("$tree/build/release/tests/viable_bench")
done
exec python3 "$root/tools/scripts/compare_bench.py" "${programs[@]}" "${@:3}"
