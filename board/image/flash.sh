#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Writes an image to a card or disk, reads it back past the page cache, and says what to do next. See --help.
# Refuses whatever is in use, or too small, or no whole disk; nothing is written before the image has been read once to
# its end and somebody has said yes.
set -euo pipefail
# shellcheck source=toolchain/say.sh
source "$(dirname "${BASH_SOURCE[0]}")/../../toolchain/say.sh"
PATH=$PATH:/usr/sbin:/sbin  # blockdev, sfdisk

usage() {
  cat <<'USAGE'
usage: board/image/flash.sh [--yes] DEVICE IMAGE
       board/image/flash.sh --verify DEVICE IMAGE
Overwrites the whole of DEVICE, such as /dev/sda or /dev/mmcblk0, with IMAGE (.img, .img.xz or .img.zst), and compares.
  --yes     does not ask; for scripts
  --verify  writes nothing, only compares. A card that has been started differs: it is for one that was just written.
  --help    this
IMAGE.sha256 beside the image is honoured, and so is that of the unpacked image beside a packed one.
Needs root, for the device. Which device is it? See what `lsblk` lists only while the card is in.
Example: sudo board/image/flash.sh /dev/sda holdfast.img.xz
USAGE
}

# refuse WHAT CAUSE NEXT
spoken=0 state="is as it was"
refuse() {
  spoken=1
  complain "$@"
  exit 1
}
# Never without a word: nobody would know how far it came.
ended() {
  (($1 == 0 || $1 == 2 || spoken)) ||
    complain "stopped with status $1; ${given:-the device} $state" \
      "it was interrupted, or an error that this script does not know" "start it again"
}
trap 'ended $?' EXIT
trap 'exit 130' INT TERM
megabytes() { echo $((($1 + 999999) / 1000000)); }

yes=0 verify=0 words=()
while (($# > 0)); do
  case $1 in
    --yes) yes=1 ;;
    --verify) verify=1 ;;
    --help | -h) usage && exit 0 ;;
    -*)
      complain "unknown option '$1'" "a typing error" "see board/image/flash.sh --help"
      exit 2
      ;;
    *) words+=("$1") ;;
  esac
  shift
done
if ((${#words[@]} != 2)); then
  complain "a device and an image are needed, and ${#words[@]} words were given" "a typing error" \
    "see board/image/flash.sh --help"
  exit 2
fi
given=${words[0]} image=${words[1]}
for tool in lsblk blockdev findmnt dd flock sha256sum; do
  command -v "$tool" >/dev/null && continue
  refuse "cannot write disks here" "$tool is not here" "apt-get install util-linux coreutils"
done

# ---- The image: its size and its sum, unpacked.

[[ -f $image ]] || refuse "there is no image $image" "a typing error, or it is not built yet" "see board/README.md, A card"
[[ -r $image ]] || refuse "$image cannot be read" "it is somebody else's" "chmod, or copy it"
case $image in
  *.img) unpack=(cat) ;;
  *.img.xz) unpack=(xz -dc) ;;
  *.img.zst) unpack=(zstd -dcq) ;;
  *) refuse "$image is no .img, .img.xz or .img.zst" "another file was meant" "give the image, or rename it" ;;
esac
command -v "${unpack[0]}" >/dev/null ||
  refuse "cannot unpack $image" "${unpack[0]} is not here" "apt-get install xz-utils zstd, or give the .img itself"

# check_sum FILE SUM: against FILE.sha256, when there is one.
check_sum() {
  [[ -f $1.sha256 ]] || return 0
  local wanted
  read -r wanted _ <"$1.sha256" || true
  [[ ${wanted,,} == "$2" ]] ||
    refuse "$1 is not what $1.sha256 says" "the download is damaged or cut short, or the two belong to different versions" \
      "fetch both again"
  say "image: as $1.sha256 says"
}

read_image() {
  local size_file
  size_file=$(mktemp)
  # Into the file and the sum at once: the image is read a single time.
  if ! sum=$("${unpack[@]}" <"$image" | tee >(wc -c >"$size_file.part" && mv "$size_file.part" "$size_file") | sha256sum); then
    rm -f "$size_file"
    refuse "$image cannot be unpacked" "the download is damaged or cut short" "fetch it again"
  fi
  sum=${sum%% *}
  while [[ ! -s $size_file ]]; do sleep 0.05; done  # tee's reader may end after it
  size=$(<"$size_file")
  rm -f "$size_file"
}

# ---- The device

# in_use: says what uses the device or a part of it; nothing: nobody does.
in_use() {
  local name numbers='' holder part
  local -a parts
  mapfile -t parts < <(lsblk -nrpo NAME "$device")
  for part in "${parts[@]}"; do
    name=$(basename "$(readlink -f "$part")")
    for holder in /sys/class/block/"$name"/holders/*; do
      [[ -e $holder ]] || continue
      echo "$part belongs to $(basename "$holder") (LVM, RAID or encryption)"
      return
    done
    if grep -q "^$part " /proc/swaps; then
      echo "$part is swap space"
      return
    fi
    numbers+=" $(<"/sys/class/block/$name/dev") $part"
  done
  # Mounts of other name spaces, too: field 3 is the device's number. (btrfs has one of its own: by name.)
  # (Processes end meanwhile, and their files with them.)
  { cat /proc/[0-9]*/mountinfo 2>/dev/null || true; } | awk -v numbers="$numbers" '
    BEGIN { n = split(numbers, word, " "); for (i = 1; i < n; i += 2) { part[word[i]] = word[i + 1]; name[word[i + 1]] = 1 } }
    { for (i = 7; i < NF && $i != "-"; ++i) { } }
    $3 in part { print part[$3] " is mounted at " $5; exit }
    $(i + 2) in name { print $(i + 2) " is mounted at " $5; exit }'
}

# under PATH: the disks that the file system of PATH lies on, one a line.
under() {
  local source
  source=$(findmnt -nvo SOURCE -T "$1" 2>/dev/null) || return 0
  [[ -b $source ]] || return 0
  lsblk -nsrpo NAME "$source" 2>/dev/null || true
}

check_device() {
  local read_only uses
  [[ -e $given ]] || refuse "there is no $given" "the card is not in, or it has another name" "compare with lsblk"
  device=$(readlink -f "$given")
  [[ -b $device ]] || refuse "$given is no disk" "a typing error: writing there would make a file" "compare with lsblk"
  kind=$(lsblk -dnro TYPE "$device")
  case $kind in
    disk | loop) ;;
    part) refuse "$given is a partition, and the image is of a whole disk" "a digit too many" \
      "give $(lsblk -dnrpo PKNAME "$device"), if nothing on it is needed" ;;
    *) refuse "$given is no whole disk but '$kind'" "another device was meant" "compare with lsblk" ;;
  esac
  ! under / | grep -qxF "$device" ||
    refuse "this system runs from $given" "another device was meant" "compare with lsblk: what has / is not the card"
  ! under "$image" | grep -qxF "$device" ||
    refuse "$image lies on $given" "another device was meant" "copy the image elsewhere, if that disk is meant"
  if [[ $kind == loop && $(lsblk -dnro NAME "$device") == loop* ]]; then
    [[ ! $(</sys/class/block/"$(basename "$device")"/loop/backing_file) -ef $image ]] ||
      refuse "$given shows $image itself" "another loop device was meant" "compare with losetup"
  fi
  uses=$(in_use)
  [[ -z $uses ]] ||
    refuse "$given is in use: $uses" "the desktop has opened the card, or another device was meant" \
      "umount it (swapoff, vgchange -an, cryptsetup close), after a look at what it is"
  capacity=$(lsblk -dnbro SIZE "$device")
  ((capacity > 0)) || refuse "$given has no size" "the reader has no card in it" "put it in"
  ((capacity >= size)) || refuse "$given is too small: $capacity bytes, and the image has $size" \
    "another device was meant, or a card of another size" "take a card of $(megabytes "$size") MB or more"
  if ((verify)); then
    [[ -r $device ]] || refuse "$given may not be read" "only root may" "run it with sudo"
    return
  fi
  read_only=$(lsblk -dnro RO "$device")
  ((read_only == 0)) || refuse "$given is read-only" "the card's slide is at LOCK, or the card has ended its life so" \
    "push the slide away from LOCK, or take another card"
  [[ -w $device ]] || refuse "$given may not be written" "only root may" "run it with sudo"
}

# ---- Write, read back

chunk=$((32 * 1024 * 1024)) block=$((4 * 1024 * 1024))
# progress WHAT DONE SINCE: of `size`. On a terminal one line that counts, else a line each tenth.
told=-1
progress() {
  local percent=$(($2 * 100 / size)) seconds=$((SECONDS - $3)) rate=''
  ((seconds == 0)) || rate=", $(($2 / 1000000 / seconds)) MB/s"
  if [[ -t 2 ]]; then
    printf '\r%s: %3d %% of %d MB%s   ' "$1" "$percent" "$(megabytes "$size")" "$rate" >&2
    (($2 < size)) || printf '\n' >&2
  elif ((percent / 10 != told)); then
    told=$((percent / 10))
    printf '%s: %d %% of %d MB%s\n' "$1" "$percent" "$(megabytes "$size")" "$rate" >&2
  fi
}

# O_DIRECT: the card's own speed is what is seen, and a card that fails is found where it fails. (dd takes it off by
# itself for an end that is no whole sector.)
write_image() {
  local done=0 start=$SECONDS now sync
  told=-1
  while ((done < size)); do
    now=$((size - done < chunk ? size - done : chunk)) sync=
    ((done + now < size)) || sync=,fsync
    dd bs="$block" count="$now" iflag=fullblock,count_bytes oflag=direct,seek_bytes seek="$done" \
      conv=nocreat,notrunc"$sync" of="$device" status=none || return 1
    done=$((done + now))
    progress writing "$done" "$start"
  done
}

# The image's bytes as the device has them, to stdout. Whole blocks, or O_DIRECT would be refused; the end is cut off.
read_device() {
  local done=0 start=$SECONDS
  told=-1
  while ((done < size)); do
    dd if="$device" bs="$block" count=$((chunk / block)) iflag=direct,skip_bytes skip="$done" status=none || return 1
    done=$((size - done < chunk ? size : done + chunk))
    progress comparing "$done" "$start"
  done
}

compare() {
  local found
  blockdev --flushbufs "$device"
  # head ends before dd does: not a failure. A read that fails is too short, and has another sum.
  found=$( (read_device || say "   the device refused to be read" >&2) | (head -c "$size" && cat >/dev/null) | sha256sum)
  [[ ${found%% *} == "$sum" ]] && return
  refuse "what $given has is not the image" \
    "a card that is worn out or claims to be larger than it is, a bad reader, or a system that was started from it" \
    "write it again, in another reader; then take another card"
}

# A GPT has a copy of itself at the end of the disk, and the image's end is not this disk's. Last, because it changes
# what was compared.
move_backup() {
  [[ $(dd if="$device" bs=512 skip=1 count=1 status=none | head -c 8) == 'EFI PART' ]] || return 0
  ((capacity > size)) || return 0
  if command -v sfdisk >/dev/null && sfdisk --help | grep -q -- --relocate &&
    sfdisk --quiet --relocate gpt-bak-std "$device" >/dev/null 2>&1; then
    say "partition table: its copy is at the end of the disk now (sfdisk)"
  elif command -v sgdisk >/dev/null && sgdisk -e "$device" >/dev/null 2>&1; then
    say "partition table: its copy is at the end of the disk now (sgdisk)"
  else
    note "the partition table's copy is not at the end of the disk: it starts all the same, and tools will say so (sfdisk 2.38 or sgdisk would move it)"
  fi
}

read_image
check_sum "$image" "$([[ ${unpack[0]} != cat && -f $image.sha256 ]] && sha256sum <"$image" | cut -d ' ' -f 1 || echo "$sum")"
[[ ${unpack[0]} == cat ]] || check_sum "${image%.*}" "$sum"
((size > 0)) || refuse "$image is empty" "the download was cut short" "fetch it again"
check_device
# While it is locked udev leaves it alone; else it would show new partitions, and a desktop mount them, in the middle.
exec {lock}<"$device"
flock --nonblock --exclusive "$lock" ||
  refuse "$given is locked" "another flash.sh, or a partition tool, is at work on it" "wait for its end"
if ((verify)); then
  compare
  say "$given has the image: $size bytes, sha256 $sum"
  exit 0
fi

printf '\n'
say "This will be overwritten, all $(megabytes "$capacity") MB of it:"
lsblk -o NAME,SIZE,TYPE,FSTYPE,LABEL,MODEL,SERIAL,TRAN "$device" | sed 's/^/   /'
say "with $image ($(megabytes "$size") MB)."
if ((yes == 0)); then
  [[ -t 0 ]] || refuse "nobody is there to say yes" "this is no terminal" "look at the lines above, then give --yes"
  read -r -p "Type ${device#/dev/} to overwrite it: " answer || answer=''
  [[ $answer == "${device#/dev/}" ]] || refuse "$given is left as it is" "'$answer' was typed" "start again when you are sure"
fi
uses=$(in_use)
[[ -z $uses ]] || refuse "$given is in use by now: $uses" "the desktop has opened the card" "umount it and start again"

state="may be half written"
"${unpack[@]}" <"$image" | write_image ||
  refuse "writing to $given failed" "the card is worn out, or was pulled out" "see the line above; try another card or reader"
state="has the image, not compared to its end"
compare
state="has the image"
say "compared: $size bytes as in the image, sha256 $sum"
move_backup
exec {lock}<&-

cat <<'STEPS'

Next:
  1. Settings: on the card's first partition, which any computer opens, `holdfastd.conf` has the options of holdfastd and
     `code`, which you may add, the console's code.
  2. Card into the Pi, the GelSight Mini into a USB port of its own, nothing on the gel, power on.
  3. Console: the port that the option --host names, on a Pi 4 /dev/ttyAMA0 (pins 8 and 10, 115200 8N1); at its other
     end `holdfast console PORT`. `status` says OK, or what is missing and what to do; `tasks` says how long the start took.
  4. A new gel, or another sensor: board/README.md, A new gel.
STEPS
