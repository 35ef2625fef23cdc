# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# The card: its two slots, its partitions, and the list of what is on it. Functions of build.sh, which sets board, work,
# kernel, version, firmware, release, release_version and SOURCE_DATE_EPOCH. Sourced, not run.
# shellcheck disable=SC2154  # of build.sh
# Everything is made from the tree and from numbers that stand here, so that the same inputs give the same bytes.

# Partitions: name, size in MiB, type. The order is that on the card. board/image/card/usr/lib/udev gives them their links in
# /dev/holdfast, and RAUC's system.conf knows the slots by these.
#   firmware  FAT: the Pi's own boot files, U-Boot, boot.scr, and the owner's holdfastd.conf and code
#   env       the boot counters, one sector (boot.cmd)
#   kernel-x  FAT: kernel, initrd, and what the initrd checks the root by
#   root-x    squashfs, and behind it its hash tree
#   data      ext4: settings, models, the log
card_partitions() {
  cat <<'TABLE'
firmware 48 EBD0A0A2-B9E5-4433-87C0-68B6B72699C7
env 1 0FC63DAF-8483-4772-8E79-3D69D8477DE4
kernel-a 64 0FC63DAF-8483-4772-8E79-3D69D8477DE4
kernel-b 64 0FC63DAF-8483-4772-8E79-3D69D8477DE4
root-a 192 0FC63DAF-8483-4772-8E79-3D69D8477DE4
root-b 192 0FC63DAF-8483-4772-8E79-3D69D8477DE4
data 64 0FC63DAF-8483-4772-8E79-3D69D8477DE4
TABLE
}
# Made up once; they only have to differ from one another.
card_uuid=6b0f4c52-7a1e-4d0b-9c43-31f0a3f5e0
# virt: without what makes emulated processors slow (tests/system/machine.cpp).
declare -A card_words=(
  [virt]="console=ttyAMA0 loglevel=4 systemd.show_status=0 panic=5 nokaslr kpti=off mitigations=off"
  [rpi4]="console=tty1 loglevel=4 systemd.show_status=0 panic=5"
)

# make_fat FILE MIB SERIAL LABEL FOLDER: a FAT of the files in FOLDER, which has no folders itself.
make_fat() {
  local file
  rm -f "$1"
  truncate -s "$2M" "$1"
  mkfs.vfat --invariant -i "$3" -n "$4" "$1" >/dev/null
  (cd "$5" && find . -type f | LC_ALL=C sort | sed 's,^\./,,') >"$work/fat_files"
  find "$5" -exec touch --no-dereference --date="@$SOURCE_DATE_EPOCH" {} +
  while read -r file; do
    TZ=UTC mcopy -m -i "$1" "$5/$file" "::$file"
  done <"$work/fat_files"
}

# The root of a slot: squashfs, and behind it the hashes that dm-verity checks it by.
make_root_image() {
  local salt blocks hash
  # (mksquashfs takes the times of itself and of whatever is younger from SOURCE_DATE_EPOCH.)
  mksquashfs "$work/root" "$work/root.img" -noappend -no-progress -quiet -comp zstd -Xcompression-level 15 -no-xattrs \
    -reproducible -processors "$(nproc)" >"$work/mksquashfs.log"
  blocks=$(($(stat -c %s "$work/root.img") / 4096))
  # A salt for each root, and the same for the same.
  salt=$(sha256sum "$work/root.img" | cut -c 1-64)
  hash=$(veritysetup format --no-superblock --hash=sha256 --data-block-size=4096 --hash-block-size=4096 \
    --data-blocks="$blocks" --hash-offset=$((blocks * 4096)) --salt="$salt" "$work/root.img" "$work/root.img" |
    awk '/^Root hash:/ { print $NF }')
  [[ ${#hash} == 64 ]] || {
    complain "veritysetup made no root hash" "another version says it otherwise" "look at board/image/card.sh"
    return 1
  }
  printf 'slot_words=holdfast.blocks=%s holdfast.hash=%s holdfast.salt=%s\n' "$blocks" "$hash" "$salt" >"$work/slot.env"
}

make_kernel_image() {
  mkdir -p "$work/kernel_files"
  cp "$kernel/vmlinuz" "$work/initrd.gz" "$work/slot.env" "$work/kernel_files/"
  printf 'release=%s\nversion=%s\nboard=%s\n' "$release" "$release_version" "$board" >"$work/kernel_files/release"
  make_fat "$work/kernel.img" 64 48464B31 HF-KERNEL "$work/kernel_files"
}

# U-Boot's script, for both boards. The Pi's own environment comes from a file on its FAT: it waits for no key, because
# what a robot sends on the serial port would be one, and starts no USB, where a camera takes seconds to answer.
make_boot_script() {
  local to=$1 at
  case $board in
    virt) at="kernel_at 0x40400000 ramdisk_at 0x48000000 words_at 0x40300000" ;;
    rpi4) at="kernel_at 0x00200000 ramdisk_at 0x08000000 words_at 0x07f00000" ;;
  esac
  {
    # shellcheck disable=SC2086  # pairs
    printf 'setenv %s %s\n' $at
    printf 'setenv board_words "%s"\n' "${card_words[$board]}"
    cat board/image/boot.cmd
  } >"$work/boot.cmd"
  mkimage -A arm64 -T script -C none -n holdfast -d "$work/boot.cmd" "$to/boot.scr" >/dev/null
}

# header_uart FILE: gives the header's pins 8 and 10 to the PL011, /dev/ttyAMA0, in one of Debian's device trees, which
# have it at the Bluetooth chip and the header at the mini UART. Debian has none of the overlays that do it elsewhere.
header_uart() {
  local pl011=/soc/serial@7e201000 mini=/soc/serial@7e215040 pins=/soc/gpio@7e200000/uart0_gpio14 handle=0x7000
  fdtput -t x "$1" "$pins" phandle "$handle" &&
    fdtput -t x "$1" "$pl011" pinctrl-0 "$handle" &&
    { fdtput -d "$1" "$pl011" uart-has-rtscts 2>/dev/null || true; } &&
    fdtput -r "$1" "$pl011/bluetooth" &&
    fdtput -t s "$1" "$mini" status disabled &&
    fdtput -t s "$1" /chosen stdout-path serial0:115200n8
}

make_firmware_image() {
  local tree dir=$work/firmware_files
  mkdir -p "$dir"
  make_boot_script "$dir"
  cp board/image/holdfastd.conf "$dir/holdfastd.conf"
  if [[ $board == rpi4 ]]; then
    cp "$firmware"/{start4.elf,fixup4.dat,u-boot.bin} "$dir/"
    for tree in bcm2711-rpi-{4-b,400,cm4-io}.dtb; do
      cp "$kernel/dtb/$tree" "$dir/"
      header_uart "$dir/$tree"
    done
    cp board/image/config.txt "$dir/"
    mkenvimage -s 0x4000 -o "$dir/uboot.env" board/image/uboot_env.txt
  fi
  make_fat "$work/firmware.img" 48 48464657 HOLDFAST "$dir"
}

# Its folders are made in it, because mke2fs would copy the moment at which they were made here.
make_data_image() {
  truncate -s 64M "$work/data.img"
  export E2FSPROGS_FAKE_TIME=$SOURCE_DATE_EPOCH
  mke2fs -q -F -t ext4 -L holdfast-data -m 0 -U "${card_uuid}d0" \
    -E "hash_seed=${card_uuid}d1,lazy_itable_init=0,lazy_journal_init=0" "$work/data.img"
  debugfs -w -f - "$work/data.img" >"$work/debugfs.log" 2>&1 <<'FOLDERS'
mkdir holdfast
sif holdfast uid 989
sif holdfast gid 989
mkdir rauc
FOLDERS
  unset E2FSPROGS_FAKE_TIME
}

# Puts the parts where the table says. Sparse: what is zero takes no room.
make_card() {
  local name mib type at=2048 k=0 table=$work/table
  printf 'BOOT_ORDER=A B\nBOOT_A_LEFT=3\nBOOT_B_LEFT=3\n' >"$work/env.txt"
  mkenvimage -s 0x200 -o "$work/env.img" "$work/env.txt"
  printf 'label: gpt\nlabel-id: %s00\nfirst-lba: 2048\n' "$card_uuid" >"$table"
  : >"$work/places"
  while read -r name mib type; do
    k=$((k + 1))
    printf 'start=%s, size=%s, type=%s, uuid=%s%02x, name="%s"%s\n' "$at" $((mib * 2048)) "$type" "$card_uuid" "$k" "$name" \
      "$([[ $name != firmware ]] || echo ', attrs="LegacyBIOSBootable"')" >>"$table"
    printf '%s %s %s\n' "${name%-[ab]}" "$at" "$mib" >>"$work/places"
    at=$((at + mib * 2048))
  done < <(card_partitions)
  rm -f "$work/card.img"
  truncate -s $((at * 512 + 1048576)) "$work/card.img"
  sfdisk --quiet --no-reread --no-tell-kernel "$work/card.img" <"$table"
  while read -r name at mib; do
    if (($(stat -c %s "$work/$name.img") > mib * 1048576)); then
      complain "$name.img does not fit into its $mib MiB" "packages grew" "raise its size in board/image/card.sh"
      return 1
    fi
    dd if="$work/$name.img" of="$work/card.img" bs=512 seek="$at" conv=notrunc,sparse status=none
  done <"$work/places"
}

# write_sbom SHA256: what is on the card, as SPDX 2.3, and the hash of each package and of the card itself.
write_sbom() {
  jq -Rn --arg board "$board" --arg card "$1" --arg version "$release_version" --arg kernel "$version" \
    --arg created "$(date -u -d "@$SOURCE_DATE_EPOCH" +%Y-%m-%dT%H:%M:%SZ)" '
    def id: "SPDXRef-" + gsub("[^A-Za-z0-9.-]"; "-");
    def hash: [{algorithm: "SHA256", checksumValue: .}];
    def package($name; $version; $arch; $from; $sha256):
      {SPDXID: ($name | id), name: $name, versionInfo: $version, downloadLocation: "NOASSERTION", filesAnalyzed: false,
       supplier: "Organization: Debian", sourceInfo: $from, checksums: ($sha256 | hash),
       externalRefs: [{referenceCategory: "PACKAGE-MANAGER", referenceType: "purl",
         referenceLocator: ("pkg:deb/debian/" + $name + "@" + ($version | @uri) + "?arch=" + $arch + "&distro=bookworm")}]};
    [inputs | split("\t") | package(.[0]; .[1]; .[2]; "built from " + .[3]; .[5])] as $packages |
    {spdxVersion: "SPDX-2.3", dataLicense: "CC0-1.0", SPDXID: "SPDXRef-DOCUMENT", name: ("holdfast-" + $board + "-" + $version),
     documentNamespace: ("https://spdx.org/spdxdocs/holdfast-" + $board + "-" + $version),
     creationInfo: {created: $created, creators: ["Tool: board/image/build.sh"]},
     packages: ([{SPDXID: "SPDXRef-holdfast", name: "holdfast", versionInfo: $version, downloadLocation: "NOASSERTION",
       filesAnalyzed: false, licenseDeclared: "Apache-2.0", supplier: "NOASSERTION",
       packageFileName: ("holdfast-" + $board + ".img"), checksums: ($card | hash)}] + $packages),
     relationships: ([{spdxElementId: "SPDXRef-DOCUMENT", relationshipType: "DESCRIBES", relatedSpdxElement: "SPDXRef-holdfast"}]
       + [$packages[] | {spdxElementId: "SPDXRef-holdfast", relationshipType: "CONTAINS", relatedSpdxElement: .SPDXID}])}' \
    <"$work/packages"
}
