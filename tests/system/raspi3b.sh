#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The Pi's card on QEMU's Raspberry Pi 3 with Debian's device tree: the U-Boot that a Pi 4 starts reads its environment and
# the slot's kernel from the card, dm-verity checks the root, and holdfastd is heard on the header's serial port.
#   tests/system/raspi3b.sh [CARD]      default build/image/rpi4/holdfast-rpi4.img
# QEMU has no Pi 4, no first stage of Raspberry Pi's, and resets at the first touch of the Pi's watchdog, so that module is
# left out. Its card reads 1 MB/s: two minutes on a quiet machine, ten at most.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
# shellcheck source=board/image/card.sh
source board/image/card.sh
PATH=$PATH:/usr/sbin:/sbin

card=${1:-build/image/rpi4/holdfast-rpi4.img} kernel=build/image/kernel logs=build/test-logs/system/raspi3b
for file in "$card" "$kernel/dtb/bcm2837-rpi-3-b.dtb" build/image/firmware-rpi4/u-boot.bin; do
  [[ -f $file ]] && continue
  complain "there is no $file" "not built" "board/image/build.sh rpi4"
  exit 1
done
mkdir -p "$logs"
rm -f "$logs/serial.log"  # of an earlier run
work=$(mktemp -d "${TMPDIR:-/tmp}/raspi3b.XXXXXX")
emulator=
trap '[[ -z $emulator ]] || kill "$emulator" 2>/dev/null; rm -rf "$work"' EXIT
trap 'exit 130' INT TERM

# A card of a power of two, as QEMU demands, with this machine's words in U-Boot's environment.
cp --sparse=always "$card" "$work/card.img"
truncate -s 1G "$work/card.img"
{ cat board/image/uboot_env.txt && echo "more_words=modprobe.blacklist=bcm2835_wdt systemd.show_status=1 console=ttyAMA0,115200"; } >"$work/env.txt"
mkenvimage -s 0x4000 -o "$work/uboot.env" "$work/env.txt"
mcopy -o -i "$work/card.img@@1M" "$work/uboot.env" ::uboot.env
cp "$kernel/dtb/bcm2837-rpi-3-b.dtb" "$work/pi3.dtb"
header_uart "$work/pi3.dtb"

qemu-system-aarch64 -M raspi3b -display none -kernel build/image/firmware-rpi4/u-boot.bin -dtb "$work/pi3.dtb" \
  -drive "file=$work/card.img,format=raw,if=sd,snapshot=on" -serial "file:$logs/serial.log" 2>"$logs/qemu.log" &
emulator=$!

# heard TEXT: it comes on the serial port before the deadline.
deadline=$((SECONDS + 600))
heard() {
  while ! sed 's/\x1b\[[0-9;]*m//g' "$logs/serial.log" 2>/dev/null | grep -aqF "$1"; do
    if ((SECONDS > deadline)) || ! kill -0 "$emulator" 2>/dev/null; then
      tail -n 30 "$logs/serial.log" | tr -d '\r' >&2
      complain "the card's Pi did not say '$1'" "it does not come so far" "see $logs/serial.log"
      exit 1
    fi
    sleep 0.5
  done
  say "raspi3b: '$1' after $SECONDS s"
}
heard "Loading Environment from FAT... OK"
heard "holdfast: slot A"
heard "Starting kernel"
heard "Found device"
heard "Started holdfastd.service"
heard "holdfast> "  # its console, on the pins of the header
if grep -aq 'Failed to start\|Failed to mount\|cannot be mounted\|emergency' "$logs/serial.log"; then
  grep -a 'Failed to start\|Failed to mount\|cannot be mounted\|emergency' "$logs/serial.log" >&2
  complain "a part of the system failed" "see above" "see $logs/serial.log"
  exit 1
fi
say "raspi3b: the card's root runs, nothing failed"
