#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Does by hand in an unpacked root (base.sh) what the packages' maintainer scripts would have done, and lays
# board/image/root over it: users, groups, links, units. For every board; build.sh calls it.
#   board/image/finish_root.sh ROOT
# Range: ROOT is fresh from base.tar; owners are kept only when this runs as root, or as root of a user namespace.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh

root=${1:-}
if [[ ! -f $root/usr/share/base-passwd/passwd.master || -e $root/etc/passwd ]]; then
  complain "cannot finish '$root'" "it is no freshly unpacked base.tar" "run board/image/build.sh, which unpacks one"
  exit 1
fi

# base-passwd, and what other packages add: NAME ID. Ids are Debian's habit; only names appear in rules and units.
cp "$root/usr/share/base-passwd/group.master" "$root/etc/group"
cp "$root/usr/share/base-passwd/passwd.master" "$root/etc/passwd"
while read -r name id; do printf '%s:x:%s:\n' "$name" "$id" >>"$root/etc/group"; done <<'GROUPS'
input 995
sgx 994
kvm 993
render 992
systemd-journal 999
systemd-network 998
gpio 990
holdfast 989
messagebus 988
GROUPS
cat >>"$root/etc/passwd" <<'USERS'
systemd-network:x:998:998:systemd Network Management:/:/usr/sbin/nologin
holdfast:x:989:989:Holdfast:/nonexistent:/usr/sbin/nologin
messagebus:x:988:988::/nonexistent:/usr/sbin/nologin
USERS
# What holdfastd opens: cameras, lines, serial ports, USB bridges. Members of groups stand behind the last colon.
for group in video gpio dialout plugdev; do sed -i "s/^\($group:.*:\)\$/\1holdfast/" "$root/etc/group"; done
# Nobody has a password, so nobody gets in by one.
sed -i 's/^\([^:]*\):[^:]*:/\1:x:/' "$root/etc/passwd" "$root/etc/group"
awk -F : '{ print $1 ":*:20000:0:99999:7:::" }' "$root/etc/passwd" >"$root/etc/shadow"
awk -F : '{ print $1 ":*::" $4 }' "$root/etc/group" >"$root/etc/gshadow"
chmod 640 "$root/etc/shadow" "$root/etc/gshadow"
chgrp 42 "$root/etc/shadow" "$root/etc/gshadow"

# base-files, dash, mawk.
for folder in root home mnt media opt srv var/log var/mail var/tmp var/lib/systemd usr/local/bin usr/local/lib; do
  mkdir -p "$root/$folder"
done
chmod 700 "$root/root"
chmod 1777 "$root/var/tmp" "$root/tmp"
rm -rf "$root/var/run" "$root/var/lock"
ln -s /run "$root/var/run"
ln -s /run/lock "$root/var/lock"
[[ -e $root/bin/sh ]] || ln -s dash "$root/bin/sh"
[[ -e $root/usr/bin/awk ]] || ln -s mawk "$root/usr/bin/awk"
cp "$root/usr/share/base-files/profile" "$root/etc/profile"
ln -sfn /proc/mounts "$root/etc/mtab"
# There is no ld.so.cache: its tool reads only the host's own kind of library, and the loader finds all in its
# built-in folders.

# systemd. Empty: made up at each start, because every board starts from the same image.
: >"$root/etc/machine-id"
mkdir -p "$root"/etc/systemd/system/{multi-user.target.wants,sysinit.target.wants,getty.target.wants}
link() { ln -sfn "$2" "$root/etc/systemd/system/$1"; }
link default.target /lib/systemd/system/multi-user.target
# D-Bus is there for RAUC, which starts it when there is something to install: its socket is enough.
rm -f "$root/lib/systemd/system/multi-user.target.wants/dbus.service"
# Nobody logs in, journals live in memory, and disks are as the image says. What is
# not started needs no time: in an emulated machine each unit costs a tenth of a second, each generator as much.
for unit in systemd-logind.service getty-static.service systemd-journal-flush.service systemd-update-utmp.service \
  systemd-update-utmp-runlevel.service systemd-pstore.service systemd-hwdb-update.service systemd-firstboot.service \
  systemd-repart.service systemd-ask-password-console.path systemd-ask-password-wall.path systemd-initctl.socket \
  proc-sys-fs-binfmt_misc.automount sys-fs-fuse-connections.mount sys-kernel-config.mount sys-kernel-debug.mount \
  sys-kernel-tracing.mount dev-hugepages.mount dev-mqueue.mount cryptsetup.target integritysetup.target \
  veritysetup.target; do
  link "$unit" /dev/null
done
mkdir -p "$root/etc/systemd/system-generators"
for generator in "$root"/lib/systemd/system-generators/*; do
  generator=${generator##*/}
  [[ $generator == systemd-fstab-generator ]] || ln -sfn /dev/null "$root/etc/systemd/system-generators/$generator"
done

cp -R board/image/root/. "$root/"
# Unlike the copies of this tree, files of a root belong to root and are not writable for others.
# Never through a link: masked units are links to /dev/null, which would be this machine's own.
find board/image/root -mindepth 1 -printf '%P\0' | while IFS= read -r -d '' path; do
  [[ -L $root/$path ]] || chmod go-w "$root/$path"
done

# Nothing changed since the last update: or systemd would do at every start what is done here.
touch "$root/etc/.updated" "$root/var/.updated"
