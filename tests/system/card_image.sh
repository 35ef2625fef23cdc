#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The card of a Pi 4 as bytes, for what no emulator starts: partitions, first stages, boot words, device tree, root. Then
# builds it once more under another clock, umask and language: the same bytes.
#   tests/system/card_image.sh [--once]      --once: without the second build. After board/image/build.sh rpi4.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
PATH=$PATH:/usr/sbin:/sbin

out=build/image/rpi4
card=$out/holdfast-rpi4.img
[[ -f $card ]] || {
  complain "there is no $card" "not built" "board/image/build.sh rpi4"
  exit 1
}
work=$(mktemp -d "${TMPDIR:-/tmp}/card.XXXXXX")
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
checks=0

# is WHAT WANTED GOT
is() {
  checks=$((checks + 1))
  [[ $2 == "$3" ]] && return
  complain "the card's $1 is '$3', not '$2'" "board/image was changed" "look at $card"
  exit 1
}
# has FILE TEXT: a line of it.
has() {
  checks=$((checks + 1))
  grep -aqxF -- "$2" "$1" && return
  complain "$(basename "$1") has no line '$2'" "board/image was changed" "look at $card"
  exit 1
}
# part NAME FILE: that partition's bytes.
part() {
  local start size
  read -r start size < <(sfdisk --json "$card" | jq -r --arg name "$1" '.partitiontable.partitions[] | select(.name == $name) | "\(.start) \(.size)"')
  dd if="$card" of="$2" bs=1M skip=$((start / 2048)) count=$((size / 2048)) conv=sparse status=none
}

(cd "$out" && sha256sum --quiet --check holdfast-rpi4.img.sha256)
is "partition table" "gpt firmware env kernel-a kernel-b root-a root-b data" \
  "$(sfdisk --json "$card" | jq -r '.partitiontable | [.label, .partitions[].name] | join(" ")')"
is "bootable partition" firmware "$(sfdisk --json "$card" | jq -r '.partitiontable.partitions[] | select(.attrs == "LegacyBIOSBootable") | .name')"

# What the Pi 4's own boot loader reads: the names are Raspberry Pi's.
part firmware "$work/firmware"
fsck.vfat -n "$work/firmware" >/dev/null
mkdir "$work/boot"
mcopy -s -i "$work/firmware" "::*" "$work/boot/"
for file in start4.elf fixup4.dat u-boot.bin bcm2711-rpi-4-b.dtb config.txt boot.scr uboot.env holdfastd.conf; do
  is "$file" yes "$([[ -s $work/boot/$file ]] && echo yes)"
done
has "$work/boot/config.txt" "arm_64bit=1"
has "$work/boot/config.txt" "kernel=u-boot.bin"
has "$work/boot/config.txt" "device_tree=bcm2711-rpi-4-b.dtb"
is "U-Boot" yes "$(grep -aq 'U-Boot 20' "$work/boot/u-boot.bin" && echo yes)"
# Pins 8 and 10 are the PL011, and the console's name in the unit's words is its.
tree=$work/boot/bcm2711-rpi-4-b.dtb
is "header's UART" "$(fdtget -t x "$tree" /soc/gpio@7e200000/uart0_gpio14 phandle)" "$(fdtget -t x "$tree" /soc/serial@7e201000 pinctrl-0)"
is "pins of the UART" "14 15" "$(fdtget "$tree" /soc/gpio@7e200000/uart0_gpio14 brcm,pins)"
is "mini UART" disabled "$(fdtget "$tree" /soc/serial@7e215040 status)"
is "Bluetooth" "" "$(fdtget -l "$tree" /soc/serial@7e201000)"
# U-Boot waits for no key and looks at the card alone. Its environment: CRC-32, then words.
crc=$(od -An -tx4 -N 4 "$work/boot/uboot.env" | tr -d ' ')
is "U-Boot's environment" "$crc" "$(tail -c +5 "$work/boot/uboot.env" | gzip -c | tail -c 8 | od -An -tx4 -N 4 | tr -d ' ')"
tail -c +5 "$work/boot/uboot.env" | tr '\0' '\n' >"$work/uboot_words"
has "$work/uboot_words" "bootdelay=-2"
is "size of the environment" 16384 "$(stat -c %s "$work/boot/uboot.env")"

# The boot counters: one sector.
part env "$work/env"
crc=$(od -An -tx4 -N 4 "$work/env" | tr -d ' ')
is "boot counters" "$crc" "$(head -c 512 "$work/env" | tail -c 508 | gzip -c | tail -c 8 | od -An -tx4 -N 4 | tr -d ' ')"
head -c 512 "$work/env" | tail -c 508 | tr '\0' '\n' >"$work/words"
for word in "BOOT_ORDER=A B" BOOT_A_LEFT=3 BOOT_B_LEFT=3; do has "$work/words" "$word"; done

# Both slots: a kernel, and a root that is what the kernel's words say.
for slot in a b; do
  part "kernel-$slot" "$work/kernel"
  fsck.vfat -n "$work/kernel" >/dev/null
  mcopy -o -i "$work/kernel" ::slot.env ::vmlinuz ::initrd.gz "$work/"
  # An arm64 image says so in its head, at byte 56.
  is "kernel's magic" "ARM" "$(tail -c +57 "$work/vmlinuz" | head -c 3)"
  blocks=$(sed -n 's/.*holdfast.blocks=\([0-9]*\).*/\1/p' "$work/slot.env")
  hash=$(sed -n 's/.*holdfast.hash=\([0-9a-f]*\).*/\1/p' "$work/slot.env")
  salt=$(sed -n 's/.*holdfast.salt=\([0-9a-f]*\).*/\1/p' "$work/slot.env")
  part "root-$slot" "$work/root"
  veritysetup verify --no-superblock --hash=sha256 --data-block-size=4096 --hash-block-size=4096 --data-blocks="$blocks" \
    --hash-offset=$((blocks * 4096)) --salt="$salt" "$work/root" "$work/root" "$hash"
  checks=$((checks + 1))
done
unsquashfs -quiet -no-progress -d "$work/tree" "$work/root" etc/rauc etc/shadow etc/passwd usr/bin/holdfastd etc/fw_env.config \
  etc/fstab usr/lib/holdfast etc/systemd/system >/dev/null 2>&1 || true
is "holdfastd" "ELF 64-bit LSB pie executable, ARM aarch64" "$(file -b "$work/tree/usr/bin/holdfastd" | cut -d , -f 1,2)"
is "who can log in" "" "$(awk -F : '$2 != "*" { print $1 }' "$work/tree/etc/shadow")"
has "$work/tree/etc/rauc/system.conf" "compatible=holdfast-rpi4"
has "$work/tree/etc/fw_env.config" "/dev/holdfast/env 0x0 0x200"
is "unit that is started" yes "$([[ -L $work/tree/etc/systemd/system/multi-user.target.wants/holdfastd.service ]] && echo yes)"
is "keys on the card" "" "$(grep -rl 'PRIVATE KEY' "$work/tree" "$work/boot" || true)"

part data "$work/data"
e2fsck -fn "$work/data" >/dev/null 2>&1
is "settings' folder" "989 (holdfast) 40755" "$(debugfs -R 'stat /holdfast' "$work/data" 2>/dev/null | awk '/Mode:/ { mode = $6 } /User:/ { user = $2 } END { print user, "(holdfast)", "4" mode }')"

# The list of what is on it.
is "SBOM" SPDX-2.3 "$(jq -r .spdxVersion "$out/holdfast-rpi4.spdx.json")"
is "packages in the SBOM" "$(($(wc -l <"$out/holdfast-rpi4.packages") + 1))" "$(jq '.packages | length' "$out/holdfast-rpi4.spdx.json")"
# The hash of each is the lock's, unless the archive has moved on, and then the build has said so; the card's is its own.
is "packages without a SHA-256" 0 "$(jq '[.packages[] | select((.checksums // []) | map(select(.algorithm == "SHA256" and (.checksumValue | test("^[0-9a-f]{64}$")))) | length != 1)] | length' "$out/holdfast-rpi4.spdx.json")"
is "card in the SBOM" "$(cut -d ' ' -f 1 "$card.sha256")" "$(jq -r '.packages[] | select(.name == "holdfast") | .checksums[0].checksumValue' "$out/holdfast-rpi4.spdx.json")"
jq -r '.packages[] | select(.name != "holdfast") | "\(.name) \(.versionInfo) \(.checksums[0].checksumValue)"' "$out/holdfast-rpi4.spdx.json" >"$work/listed"
awk '$1 !~ /^(sysroot|host|#)/ { print $2, $3, $5 }' board/image/packages.lock >"$work/locked"
is "hashes that are not the lock's" "" "$(awk 'NR == FNR { hash[$1 " " $2] = $3; next } $1 " " $2 in hash && hash[$1 " " $2] != $3 { print $1 }' "$work/locked" "$work/listed")"
is "packages without a version" 0 "$(jq '[.packages[] | select(.versionInfo == null or .versionInfo == "")] | length' "$out/holdfast-rpi4.spdx.json")"
say "card: $checks checks of the Pi 4's card passed"

[[ ${1:-} != --once ]] || exit 0
keyring=()
[[ ! -f $work/tree/etc/rauc/keyring.pem ]] || keyring=(--keyring "$work/tree/etc/rauc/keyring.pem")
# shellcheck disable=SC2016  # the inner shell's
quietly "$work/again.log" env TZ=Pacific/Auckland LC_ALL=C.UTF-8 bash -c 'umask 077 && exec board/image/build.sh rpi4 --newer --out "$0" "$@"' \
  "$work/again" "${keyring[@]}"
is "second build" "$(cut -d ' ' -f 1 "$card.sha256")" "$(cut -d ' ' -f 1 "$work/again/holdfast-rpi4.img.sha256")"
say "card: built again under another clock, umask and language, it has the same sha256"
