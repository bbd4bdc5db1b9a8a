#!/usr/bin/env bash
# Records the plugin interface of this version (classes, members, virtual tables) in tests/interface/version_<N>.abi, which
# the tests compare with. For whoever raised kPluginInterfaceVersion. Usage: tools/scripts/record_interface.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
tools/setup.sh release viable_interface
exec tests/interface/check.sh record build/release/tests/interface/libviable_interface.so
