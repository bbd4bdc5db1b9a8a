#!/usr/bin/env bash
# Every tracked C++ file is as clang-format 14 leaves it (.clang-format). Usage: format.sh
# Exit code 77, nothing checked: clang-format is of another version, which leaves other forms. Debian 12 has 14.
set -euo pipefail
cd "$(dirname "$0")/../.."
version=$(clang-format --version | sed -n 's/.*version \([0-9]*\).*/\1/p')
if [ "$version" != 14 ]; then
  echo "format: skipped: clang-format is version $version here, and the form of the sources is that of 14 (Debian 12's)" >&2
  exit 77
fi
mapfile -t files < <(git ls-files '*.cpp' '*.h')
if printf '%s\0' "${files[@]}" | xargs -0 -n 32 -P "$(nproc)" clang-format --dry-run -Werror; then
  echo "format: ${#files[@]} files are in form"
else
  echo "format: run clang-format -i on the files above" >&2
  exit 1
fi
