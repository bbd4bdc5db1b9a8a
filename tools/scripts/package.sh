#!/usr/bin/env bash
# Builds the Debian packages: libviable (library, headers, CMake files, robots), viable (program, plugins, experiments) and
# python3-viable. Install them with `apt-get install ./FILE...`, which brings what they depend on. Usage: tools/scripts/package.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
rm -f build/release/{lib,}viable_*.deb build/release/python3-viable_*.deb
tools/setup.sh release viable_package
for file in build/release/{lib,}viable_*.deb build/release/python3-viable_*.deb; do
  echo "package: $file ($(du -h --apparent-size "$file" | cut -f1))"
done
