#!/usr/bin/env bash
# The two commands of the README on another Debian: makes a root folder of it, copies the sources into it as they are in the
# working tree, and runs tools/run.sh and tools/test.sh there. Usage, as root:
#   tools/scripts/other_debian.sh RELEASE [--root FOLDER] [arguments of tools/test.sh]
# RELEASE: trixie, bookworm. FOLDER: build/roots/RELEASE by default; some GB, used again the next time with all that is built there.
# Archive, proxy and certificates are those that apt has here. debootstrap must be installed.
set -euo pipefail
fail() {
  echo "other_debian: $1" >&2
  exit 2
}
release=${1:-}
[[ "$release" =~ ^[a-z]+$ ]] || fail "name a release: tools/scripts/other_debian.sh trixie"
[ "$(id -u)" -eq 0 ] || fail "this makes a root folder and mounts in it: run it as root, sudo $0 $*"
command -v debootstrap >/dev/null || fail "debootstrap is missing: apt-get install debootstrap"
[ -e "/usr/share/debootstrap/scripts/$release" ] || fail "debootstrap knows no release $release"
# All that is mounted below is so for this process and its children alone, and gone with them, however they end.
if [ -z "${VIABLE_OTHER_DEBIAN:-}" ]; then
  VIABLE_OTHER_DEBIAN=1 exec unshare --mount --propagation private "$0" "$@"
fi
unset VIABLE_OTHER_DEBIAN
shift
project=$(realpath "$(dirname "$0")/../..")
root=$project/build/roots/$release
checkout=/srv/viable  # in the root. Not /viable: that is a part of usr/lib/viable, and the test of the package looks for it
if [ "${1:-}" = --root ]; then
  root=$(realpath -m "${2:?other_debian: --root takes a folder}")
  shift 2
fi
cd "$project"

if [ ! -e "$root" ]; then
  eval "$(apt-config shell proxy Acquire::http::Proxy)"
  archive=$(apt-get indextargets --format '$(RELEASE) $(COMPONENT) $(REPO_URI)' 'Created-By: Packages' |
    awk '$1 !~ /-|\// && $2 == "main" && $3 ~ /\/debian\/?$/ && !found { print $3; found = 1 }')
  [ -n "$archive" ] || fail "apt has no archive of a Debian release in its sources (.../debian, main)"
  echo "other_debian: making $root from $archive"
  mkdir -p "$(dirname "$root")"
  rm -rf "$root.part"  # of a try that was ended
  ${proxy:+env http_proxy="$proxy"} debootstrap --variant=minbase --include=ca-certificates "$release" "$root.part" "$archive" \
    >"$root.log" 2>&1 || { tail -n 20 "$root.log" >&2; fail "debootstrap failed: $root.log"; }
  mv "$root.part" "$root"
fi
apt-config dump | grep -E '^Acquire::(https?|Check)' >"$root/etc/apt/apt.conf.d/90host" || true
for file in /etc/resolv.conf /etc/hosts; do
  [ ! -e "$file" ] || cp --dereference "$file" "$root$file"
done
[ ! -d /usr/local/share/ca-certificates ] || cp -r /usr/local/share/ca-certificates "$root/usr/local/share"
chroot "$root" update-ca-certificates >/dev/null 2>&1

echo "other_debian: copying the sources to $root$checkout"
mkdir -p "$root$checkout"
find "$root$checkout" -mindepth 1 -maxdepth 1 ! -name build -exec rm -rf {} +
git -c safe.directory="$PWD" ls-files -z --cached --others --exclude-standard | while IFS= read -r -d '' file; do
  [ ! -e "$file" ] || printf '%s\0' "$file"
done | tar --create --null --files-from - | tar --extract --no-same-owner --directory "$root$checkout"

mount -t proc proc "$root/proc"
mount --rbind /sys "$root/sys"
mount --rbind /dev "$root/dev"
inside() {
  env -u TMPDIR -u CC -u CXX -u PYTHONPATH -u VIRTUAL_ENV HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 \
    NODE_EXTRA_CA_CERTS=/etc/ssl/certs/ca-certificates.crt chroot "$root" "$@"
}
begin=$SECONDS
inside "$checkout/tools/run.sh"
echo "other_debian: tools/run.sh took $((SECONDS - begin)) s on $release"
begin=$SECONDS
status=0
inside "$checkout/tools/test.sh" "$@" || status=$?
echo "other_debian: tools/test.sh took $((SECONDS - begin)) s on $release"
exit $status
