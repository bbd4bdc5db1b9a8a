#!/usr/bin/env bash
# Follows a ten-minute guide as it is printed: in an empty folder, as a user with an empty home, with viable freshly
# installed to ~/viable. Usage: guide.sh BUILD_DIR GUIDE.md
#
# Of the page it runs every ```sh block, in order and in one shell, and writes every other block that follows a line
# <!-- file: NAME --> to that file. More such lines: <!-- not run: why --> before a block that is left out, <!-- fails -->
# before one that must fail, <!-- check: COMMAND --> for what must be true then ("$last_output": what the last block printed).
set -euo pipefail
build=$1 guide=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
unset VIABLE_PLUGIN_PATH VIABLE_ROBOT_PATH
export HOME=$work/home
mkdir -p "$HOME" "$work/empty"
cmake --install "$build" --prefix "$HOME/viable" >/dev/null
export last_output=$work/last_output

awk '
  /^<!-- (file|check|not run): .* -->$|^<!-- fails -->$/ {
    kind = $2; text = $0; sub(/^<!-- [a-z ]+: /, "", text); sub(/ -->$/, "", text)
    if (kind == "check:") { gsub(/\047/, "\047\\\047\047", text); print "check \047" text "\047"; checks++ }
    else if (kind == "file:") file = text
    else if (kind == "not") skip = 1
    else fails = 1
    next
  }
  /^<!--/ { print "page, line " NR ": not understood: " $0 > "/dev/stderr"; exit 1 }
  /^```/ && inside == "" {
    if (skip) inside = "skip"
    else if (file != "") { inside = "file"; print "cat >\"" file "\" <<\047END_OF_FILE\047" }
    else if ($0 == "```sh") {
      inside = "sh"; blocks++
      print "echo \"guide: line " NR "\""
      print (fails ? "if {" : "{")
    } else inside = "text"
    next
  }
  /^```$/ {
    if (inside == "file") print "END_OF_FILE"
    if (inside == "sh") {
      print "} >\"$last_output\" 2>&1" (fails ? "; then echo \"line " NR ": this should fail\"; exit 1; fi" : "")
      fails = 0
    }
    inside = file = ""; skip = 0
    next
  }
  inside == "sh" || inside == "file" { print }
  END { if (inside != "" || blocks < 3 || checks < 1) { print "page: too little to run" > "/dev/stderr"; exit 1 } }
' "$guide" >"$work/steps"

cat >"$work/guide" <<'END'
set -euo pipefail
exec 3>&1  # where a block fails, the trap inherits the block's output
trap 'code=$?; [ $code = 0 ] || { echo "guide: failed; the last block printed:"; cat "$last_output"; } >&3' EXIT
check() { eval "$1" || { echo "guide: not true: $1"; exit 1; }; }
END
cat "$work/steps" >>"$work/guide"
cd "$work/empty"
start=$SECONDS
bash "$work/guide"
echo "guide: $(basename "$(dirname "$guide")")/README.md works as printed, in $((SECONDS - start)) s"
