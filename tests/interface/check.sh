#!/usr/bin/env bash
# Describes the plugin interface and compares it with the record, tests/interface/version_<N>.abi, or writes the record.
# Usage: check.sh check|record LIBRARY   (LIBRARY: the target viable_interface; `record` is what tools/scripts/record_interface.sh does)
set -euo pipefail
mode=$1 library=$2
here=$(cd "$(dirname "$0")" && pwd)
header=$here/../../framework/include/viable/plugin/PluginExport.h
version=$(sed -n 's/.*kPluginInterfaceVersion = \([0-9]*\);.*/\1/p' "$header")
[ -n "$version" ] || { echo "interface: $header declares no kPluginInterfaceVersion" >&2; exit 1; }
command -v abidw >/dev/null || { echo "interface: abidw is missing: apt-get install abigail-tools" >&2; exit 1; }
new=$(mktemp --suffix .abi)
trap 'rm -f "$new"' EXIT
# Nothing of the machine: no paths, no lines, no names of libraries.
abidw --suppressions "$here/foreign_types.ini" --no-corpus-path --no-show-locs --no-comp-dir-path --no-elf-needed \
  --no-architecture --no-parameter-names --type-id-style hash --out-file "$new" "$library"
sed -i "s|path='[^']*/Interface.cpp'|path='Interface.cpp'|" "$new"
python3 "$here/strip.py" "$new" "$new"

shopt -s nullglob
records=("$here"/version_*.abi)
record=$here/version_$version.abi
if [ "$mode" = record ]; then
  if [ -e "$record" ] && ! abidiff --harmless --suppressions "$here/foreign_types.ini" "$record" "$new" >/dev/null; then
    echo "interface: version $version is on record and the interface differs from it: raise kPluginInterfaceVersion first." \
      "Where that version was never released, remove tests/interface/version_$version.abi yourself." >&2
    exit 1
  fi
  for old in "${records[@]}"; do rm "$old"; done
  cp "$new" "$record"
  chmod 644 "$record"
  echo "interface: recorded version $version in tests/interface/version_$version.abi: commit it"
  exit 0
fi
if [ "${records[*]}" != "$record" ]; then
  echo "interface: PluginExport.h says version $version, recorded is: ${records[*]##*/}." \
    "Run tools/scripts/record_interface.sh and commit the record with the change." >&2
  exit 1
fi
if ! abidiff --harmless --suppressions "$here/foreign_types.ini" "$record" "$new"; then
  cat >&2 <<EOF
interface: the layout or the virtual tables of the plugin interface differ from those recorded for version $version (above).
A plugin built before would be loaded and misread memory. Raise kPluginInterfaceVersion in
framework/include/viable/plugin/PluginExport.h, say so in CHANGELOG.md (Breaking), and run tools/scripts/record_interface.sh.
EOF
  exit 1
fi
