#!/usr/bin/env bash
# Builds the Debian package: program, plugins, robots, experiments, headers, CMake files. Install it with
# `apt-get install ./FILE`, which brings what it depends on. Usage: tools/scripts/package.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
rm -f build/release/viable_*.deb
tools/setup.sh release viable_package
for file in build/release/viable_*.deb; do
  echo "package: $file ($(du -h --apparent-size "$file" | cut -f1))"
done
