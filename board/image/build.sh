#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds what the emulated machine starts from: build/image/virt/{vmlinuz,initrd.gz,root.ext4}, with Debian's stock
# kernel. See --help. Kernel and base are fetched once; from then on a build takes seconds.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
PATH=$PATH:/usr/sbin:/sbin  # depmod, modprobe, mke2fs

usage() {
  cat <<'USAGE'
usage: board/image/build.sh [--install DIR]... [--login TTY] [--out DIR]
  --install DIR  a tree that is laid over the root: DIR/usr/bin/holdfastd, DIR/lib/systemd/system/..., DIR/etc/holdfast/...
                 Its units with an [Install] section are enabled. May be given again; later ones win.
  --login TTY    a root login without password on this terminal, ttyAMA0 for instance; nobody can log in otherwise
  --out DIR      where vmlinuz, initrd.gz and root.ext4 go; build/image/virt unless given
  --help         this
Needs mmdebstrap, arch-test, kmod, cpio, e2fsprogs and, the first time, network; root, or user namespaces with uidmap.
Example: board/image/build.sh --install build/image/stage
USAGE
}

installs=() login='' out=build/image/virt
given=("$@")
while (($# > 0)); do
  case $1 in
    --install | --login | --out)
      if [[ -z ${2:-} ]]; then
        complain "$1 names nothing" "a typing error" "see board/image/build.sh --help"
        exit 2
      fi
      case $1 in
        --install) installs+=("$2") ;;
        --login) login=$2 ;;
        --out) out=$2 ;;
      esac
      shift
      ;;
    --help | -h) usage && exit 0 ;;
    *)
      complain "unknown option '$1'" "a typing error" "see board/image/build.sh --help"
      exit 2
      ;;
  esac
  shift
done
for dir in "${installs[@]}"; do
  [[ -d $dir ]] && continue
  complain "there is no $dir to install" "it is not built yet" "build the board first, or leave --install out"
  exit 1
done
for tool in depmod modprobe cpio mke2fs; do
  command -v "$tool" >/dev/null && continue
  complain "cannot build the image" "$tool is not here" "apt-get install kmod cpio e2fsprogs"
  exit 1
done

# Before the namespace: mmdebstrap makes its own. Inside it they find everything there.
board/image/kernel.sh
board/image/base.sh
# Files of the root belong to several users, which only root can make; root of a namespace will do.
if ((EUID != 0)); then
  exec unshare --user --map-root-user --map-auto -- "$0" "${given[@]}"
fi

# By what the machine of tests/system has: disk and console by virtio, USB camera, watchdog; serial adapters and
# the USB-HID bridge for whoever plugs one in. GPIO, PCI serial and hidraw are built in.
root_modules=(virtio_console virtio_rng xhci_pci uvcvideo i6300esb ftdi_sio cp210x hid_generic usbhid hid_mcp2221 uhid loop)
initrd_modules=(virtio_mmio virtio_pci virtio_blk ext4)
kernel=build/image/kernel
version=$(cat "$kernel/version")
work=$(mktemp -d build/image/work.XXXXXX)
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM

# timed WHAT COMMAND...: says how long it took.
timed() {
  local what=$1 start=${EPOCHREALTIME/./} took
  shift
  "$@"
  took=$(((${EPOCHREALTIME/./} - start) / 100000))
  printf 'image: %-28s %3d.%d s\n' "$what" $((took / 10)) $((took % 10))
}

# with_dependencies MODULE...: files of the modules and of all that they need, in the order in which they can be loaded.
with_dependencies() {
  local module
  for module in "$@"; do
    modprobe -d "$kernel" -S "$version" --show-depends "$module"
  done | awk '$1 == "insmod" && !seen[$2]++ { print $2 }'
}

unpack() { mkdir "$work/root" && tar -C "$work/root" --numeric-owner -xf build/image/base.tar; }

install_modules() {
  local from=$kernel/lib/modules/$version to=$work/root/lib/modules/$version path
  mkdir -p "$to"
  cp "$from"/modules.{builtin,builtin.modinfo,order} "$to/"
  with_dependencies "${root_modules[@]}" >"$work/root_modules"
  while read -r path; do
    path=${path#*/lib/modules/"$version"/}
    mkdir -p "$to/$(dirname "$path")"
    cp "$from/$path" "$to/$path"
  done <"$work/root_modules"
  depmod -b "$work/root" "$version"
}

# enable_unit FILE: as `systemctl enable` does, for units wanted by a target.
enable_unit() {
  local wanted_by
  wanted_by=$(sed -n 's/^WantedBy=//p' "$1")
  for wanted_by in $wanted_by; do
    mkdir -p "$work/root/etc/systemd/system/$wanted_by.wants"
    ln -sfn "${1#"$work/root"}" "$work/root/etc/systemd/system/$wanted_by.wants/$(basename "$1")"
  done
}

# install_tree DIR: lays it over the root, owned by root. The root's /lib is a link to /usr/lib, so no folder may
# take its place.
install_tree() {
  local unit
  tar -C "$1" --owner=0 --group=0 --numeric-owner --mode=go-w -cf - . |
    tar -C "$work/root" --keep-directory-symlink --no-overwrite-dir -xf -
  while read -r unit; do
    enable_unit "$work/root/$unit"
  done < <(cd "$1" && find . -path '*/systemd/system/*' -type f \( -name '*.service' -o -name '*.timer' -o -name '*.socket' \
    -o -name '*.path' \) -exec grep -l '^\[Install\]' {} + | sed 's/^\.\///')
}

install_all() {
  local dir
  install_modules
  for dir in board/image/virt "${installs[@]}"; do install_tree "$dir"; done
  [[ -n $login ]] || return 0
  mkdir -p "$work/root/etc/systemd/system/serial-getty@$login.service.d"
  printf '[Service]\nExecStart=\nExecStart=-/sbin/agetty --autologin root --keep-baud 115200,9600 %%I vt220\n' \
    >"$work/root/etc/systemd/system/serial-getty@$login.service.d/autologin.conf"
  ln -sfn /lib/systemd/system/serial-getty@.service \
    "$work/root/etc/systemd/system/getty.target.wants/serial-getty@$login.service"
}

make_initrd() {
  local dir=$work/initrd
  mkdir -p "$dir"/{bin,dev,modules,proc,root,sys}
  cp "$work/root/bin/busybox" "$dir/bin/"
  ln -s busybox "$dir/bin/sh"
  cp board/image/initrd_init "$dir/init"
  with_dependencies "${initrd_modules[@]}" >"$work/initrd_modules"
  xargs -d '\n' cp -t "$dir/modules" <"$work/initrd_modules"
  sed 's,.*/,,' "$work/initrd_modules" >"$dir/modules/order"
  (cd "$dir" && find . -print0 | sort -z | cpio --null --create --format=newc --quiet --owner=0:0 | gzip -1) >"$work/initrd.gz"
}

# A quarter more than the files take, for inodes, journal and what a machine writes.
make_ext4() {
  local size
  size=$(($(du -sm "$work/root" | cut -f 1) * 5 / 4 + 64))
  truncate -s "${size}M" "$work/root.ext4"
  mke2fs -q -F -t ext4 -L holdfast -m 0 -d "$work/root" "$work/root.ext4"
}

timed "unpack Debian" unpack
timed "finish the root" board/image/finish_root.sh "$work/root"
timed "modules, installed files" install_all
timed "initrd" make_initrd
timed "ext4 image" make_ext4
mkdir -p "$out"
cp "$kernel/vmlinuz" "$work/vmlinuz"
mv "$work"/{vmlinuz,initrd.gz,root.ext4} "$out/"
say "image: $out has kernel $version, root of $(du -m --apparent-size "$out/root.ext4" | cut -f 1) MB ($(du -m "$out/root.ext4" | cut -f 1) MB used)"
