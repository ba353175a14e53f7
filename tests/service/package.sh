#!/usr/bin/env bash
# Installs, upgrades and removes the Debian package in a clean root: package.sh OLD.deb NEW.deb, as root, on a
# Debian with mmdebstrap. A run is measured before the upgrade and must be there after the removal.
set -euo pipefail
old=$(realpath "$1") new=$(realpath "$2")
releases=$(realpath "$(dirname "$0")/../../crates/rigd/tests/data/releases")
fail() { printf 'FAILED: %s\n' "$*" >&2; exit 1; }
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
shopt -s nullglob
mmdebstrap --quiet --variant=minbase --mode=root "$(. /etc/os-release && echo "$VERSION_CODENAME")" "$root" \
  /etc/apt/sources.lis[t] /etc/apt/sources.list.d/*.{list,sources} || fail "no clean root can be made"
cp "$old" "$root/old.deb"
cp "$new" "$root/new.deb"
inside() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive "$@"; }
install_deb() {
  inside apt-get install -y -qq --no-install-recommends "$1" > "$root/apt.log" 2>&1 ||
    { cat "$root/apt.log"; fail "$1 cannot be installed"; }
}
as_rigd() { inside setpriv --reuid rigd --regid rigd --clear-groups --reset-env "$@"; }

inside apt-get update -qq || fail "the package lists of the clean root"
install_deb /old.deb
inside getent passwd rigd > /dev/null || fail "no user rigd"
[ "$(inside stat -c '%U %a' /var/lib/rigd)" = "rigd 750" ] || fail "the data directory"
[ -L "$root/etc/systemd/system/multi-user.target.wants/rigd.service" ] || fail "the service is not enabled"
# Its socket is for those who ask for it: it would start a daemon again that a person has stopped.
units=$(inside find /lib/systemd /usr/lib/systemd /etc/systemd -name 'rigd*' ! -name rigd.service)
[ -z "$units" ] || fail "other units than the service are installed: $units"
[ -s "$root/usr/share/rigd/service/rigd.socket" ] || fail "the example of a socket is missing"
for file in /usr/share/man/man1/rigd-run.1.gz /usr/share/bash-completion/completions/rigd \
  /usr/lib/udev/rules.d/99-rigd.rules /usr/share/rigd/service/alerts.yml; do
  [ -s "$root$file" ] || fail "$file is missing"
done
share=/usr/share/rigd
as_rigd rigd run "$share/protocols/smoke.toml" --rig "$share/rigs/simulated.toml" --data /var/lib/rigd > /dev/null ||
  fail "the installed program cannot measure"
inside cp "$share/rigs/bench.toml" /etc/rigd/rig.toml
echo "# of this bench" >> "$root/etc/rigd/rig.toml"

install_deb /new.deb
[ "$(inside dpkg-query -Wf '${Version}' rigd)" = "$(dpkg-deb -f "$new" Version)" ] || fail "the version after the upgrade"
grep -q "of this bench" "$root/etc/rigd/rig.toml" || fail "the upgrade changed the rig file"
as_rigd rigd verify latest --data /var/lib/rigd || fail "the run after the upgrade"
# The installed program reads the data of every release.
for release in "$releases"/*; do
  cp -r "$release/data" "$root/var/lib/rigd-of-a-release"
  inside chown -R rigd:rigd /var/lib/rigd-of-a-release
  for run in release-2 latest; do
    as_rigd rigd verify "$run" --data /var/lib/rigd-of-a-release > /dev/null ||
      fail "$run in the data of release $(basename "$release")"
  done
  rm -r "$root/var/lib/rigd-of-a-release"
done

inside apt-get remove -y -qq rigd > /dev/null 2>&1 || fail "it cannot be removed"
[ ! -e "$root/usr/bin/rigd" ] || fail "the program is still there"
inside dpkg --purge rigd 2>&1 | grep -q "measurements are kept" || fail "the purge does not say what it keeps"
[ -s "$root/var/lib/rigd/rigd.db" ] || fail "the purge removed the measurements"
[ -s "$root/etc/rigd/rig.toml" ] || fail "the purge removed the rig file that a person wrote"
printf 'installed, upgraded and removed; the run is still there\n'
