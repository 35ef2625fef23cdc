# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# The tree of a board's root, and the initrd that finds it: functions of build.sh, which sets board, work, kernel,
# version, installs, login and SOURCE_DATE_EPOCH. Sourced, not run.
# shellcheck disable=SC2154  # of build.sh

# What is loaded by name or by udev. virt: by what the machine of tests/system has - disk and console by virtio, USB
# camera, watchdog. Both: serial adapters and the USB-HID bridge for whoever plugs one in, a stick with an update, and
# what an update is mounted by. GPIO, PCI and hidraw are built in.
declare -A root_modules=(
  [virt]="virtio_console virtio_rng i6300esb"
  [rpi4]="bcm2835_wdt raspberrypi-cpufreq bcm2711_thermal bcm2835_thermal dwc2 phy-generic bcm2835-rng"
)
common_modules="xhci_pci uvcvideo ftdi_sio cp210x cdc_acm hid_generic usbhid hid_mcp2221 uhid usb_storage sd_mod vfat nls_cp437
  nls_ascii nls_iso8859-1 ext4 loop squashfs dm_verity sha2-ce sha256-arm64"
# What stands between the kernel and its root. The Pi 3's are for the smoke test on the emulated one.
declare -A initrd_modules=(
  [virt]="virtio_mmio virtio_pci virtio_blk ext4"
  [rpi4]="reset-raspberrypi sdhci_iproc bcm2835"
)
common_initrd_modules="squashfs dm_verity sha2-ce sha256-arm64"

# with_dependencies MODULE...: files of the modules and of all that they need, in the order in which they can be loaded.
with_dependencies() {
  local module
  for module in "$@"; do
    modprobe -d "$kernel" -S "$version" --show-depends "$module" || {
      complain "the kernel $version has no module $module" "another kernel names it otherwise" \
        "look for it in $kernel/lib/modules, and put its name into board/image/tree.sh"
      return 1
    }
  done >"$work/insmod" || return 1
  awk '$1 == "insmod" && !seen[$2]++ { print $2 }' "$work/insmod"
}

# (What mmdebstrap says about the archive is of this machine, and no board has apt.)
unpack() { mkdir "$work/root" && tar -C "$work/root" --numeric-owner --exclude=./etc/apt -xf build/image/base.tar; }

install_modules() {
  local from=$kernel/lib/modules/$version to=$work/root/lib/modules/$version path
  mkdir -p "$to"
  cp "$from"/modules.{builtin,builtin.modinfo,order} "$to/"
  # shellcheck disable=SC2086  # lists of words
  with_dependencies ${root_modules[$board]} $common_modules >"$work/root_modules"
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
  [[ ! -d board/image/$board ]] || install_tree "board/image/$board"
  for dir in "${installs[@]}"; do install_tree "$dir"; done
  [[ -n $login ]] || return 0
  mkdir -p "$work/root/etc/systemd/system/serial-getty@$login.service.d"
  printf '[Service]\nExecStart=\nExecStart=-/sbin/agetty --autologin root --keep-baud 115200,9600 %%I vt220\n' \
    >"$work/root/etc/systemd/system/serial-getty@$login.service.d/autologin.conf"
  ln -sfn /lib/systemd/system/serial-getty@.service \
    "$work/root/etc/systemd/system/getty.target.wants/serial-getty@$login.service"
}

# libraries_of PROGRAM: the files below the root that it needs to start, the loader among them.
libraries_of() {
  local -a todo=("$1")
  local -A seen=()
  local file name path
  while ((${#todo[@]} > 0)); do
    file=${todo[0]} todo=("${todo[@]:1}")
    while read -r name; do
      [[ -z ${seen[$name]:-} ]] || continue
      seen[$name]=yes
      for path in "$work/root/usr/lib/aarch64-linux-gnu/$name" "$work/root/lib/aarch64-linux-gnu/$name" "$work/root/lib/$name"; do
        [[ -e $path ]] || continue
        printf '%s\n' "$path"
        todo+=("$path")
        continue 2
      done
      complain "$1 needs $name, which the root does not have" "a package of board/image/base.sh changed" "add its package there"
      return 1
    done < <(aarch64-linux-gnu-readelf -d "$file" | sed -n 's/.*(NEEDED).*\[\(.*\)\]/\1/p')
  done
  printf '%s\n' "$work/root/lib/ld-linux-aarch64.so.1"
}

make_initrd() {
  local dir=$work/initrd file
  mkdir -p "$dir"/{bin,dev,lib,modules,proc,root,sys}
  cp "$work/root/bin/busybox" "$work/root/sbin/dmsetup" "$dir/bin/"
  ln -s busybox "$dir/bin/sh"
  libraries_of "$work/root/sbin/dmsetup" >"$work/libraries"
  while read -r file; do cp -L "$file" "$dir/lib/"; done <"$work/libraries"
  cp board/image/initrd_init "$dir/init"
  # shellcheck disable=SC2086  # lists of words
  with_dependencies ${initrd_modules[$board]} $common_initrd_modules >"$work/initrd_modules"
  xargs -d '\n' cp -t "$dir/modules" <"$work/initrd_modules"
  sed 's,.*/,,' "$work/initrd_modules" >"$dir/modules/order"
  find "$dir" -exec touch --no-dereference --date="@$SOURCE_DATE_EPOCH" {} +
  # Names in order, no inode numbers, no time in gzip's head: the same bytes whenever it is made.
  (cd "$dir" && find . -print0 | LC_ALL=C sort -z |
    cpio --null --create --format=newc --quiet --owner=0:0 --reproducible | gzip -n -6) >"$work/initrd.gz"
}
