#!/usr/bin/env bash
# Generates tables and schema into a copy and compares. Usage: generated.sh BUILD_DIR SOURCE_DIR
set -euo pipefail
build=$1 source=$2
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
cp -r "$source/plugins" "$source/experiments" "$copy"
"$source/tools/scripts/generate_docs.sh" "$build" "$copy"
for folder in plugins experiments; do
  diff -r "$source/$folder" "$copy/$folder" || {
    echo "generated: these files (< as they are, > as the declarations say) are out of date: run tools/scripts/generate_docs.sh" >&2
    exit 1
  }
done
