#!/usr/bin/env bash
# Every tracked C++ file is as clang-format leaves it (.clang-format; version 14, Debian 12's). Usage: format.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
mapfile -t files < <(git ls-files '*.cpp' '*.h')
if printf '%s\0' "${files[@]}" | xargs -0 -n 32 -P "$(nproc)" clang-format --dry-run -Werror; then
  echo "format: ${#files[@]} files are in form"
else
  echo "format: run clang-format -i on the files above" >&2
  exit 1
fi
