#!/usr/bin/env bash
# Generates the tables into a copy and compares. Usage: generated.sh BUILD_DIR SOURCE_DIR
set -euo pipefail
build=$1 source=$2
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
cp -r "$source/plugins" "$copy"
"$source/tools/scripts/generate_docs.sh" "$build" "$copy"
diff -r "$source/plugins" "$copy/plugins" || {
  echo "generated: these files (< as they are, > as the declarations say) are out of date: run tools/scripts/generate_docs.sh" >&2
  exit 1
}
