#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the card of a board, build/image/BOARD/holdfast-BOARD.img, from Debian's packages. See --help.
# Kernel, packages and first stages are fetched once; from then on a build takes half a minute and the same inputs give
# the same bytes. Nothing of arm64 runs here.
set -euo pipefail
called_from=$PWD
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
# shellcheck source=board/image/tree.sh
source board/image/tree.sh
# shellcheck source=board/image/card.sh
source board/image/card.sh
# shellcheck source=toolchain/locked.sh
source toolchain/locked.sh
PATH=$PATH:/usr/sbin:/sbin  # depmod, modprobe, mke2fs, mkfs.vfat, sfdisk, veritysetup
umask 022

usage() {
  cat <<'USAGE'
usage: board/image/build.sh virt|rpi4 [--install DIR]... [--keyring FILE] [--login TTY] [--release FILE]
                            [--rt] [--newer] [--flat] [--out DIR]
What build/rpi4 has of the board is installed; build the preset rpi4 first.
  --install DIR   a tree that is laid over the root: DIR/usr/bin/..., DIR/etc/holdfast/...; its units with an [Install]
                  section are enabled. May be given again; later ones win.
  --keyring FILE  the owner's keyring (board/image/keys.sh makes one): updates are taken that a signer of its authority has
                  signed whom it has not revoked, and no others.
                  Without it the card takes no updates.
  --login TTY     a root login without password on this terminal; nobody can log in otherwise. Not for a board in use.
  --release FILE  instead of board/image/release: version, release, floor
  --newer         for tests: packages that are here, or that the archive has today, instead of those that
                  board/image/packages.lock pins by version and SHA-256; each other one is named. Without it a package that
                  cannot be had as locked ends the build
  --rt            Debian's kernel with PREEMPT_RT instead of the stock one
  --flat          for tests: instead of the card only what an emulator starts without a boot loader: vmlinuz, initrd.gz, root.ext4
  --out DIR       where all goes; build/image/BOARD unless given
  --help          this
Leaves holdfast-BOARD.img with .sha256, .packages (a list) and .spdx.json (the same as SBOM), and slot/ for board/image/bundle.sh.
Needs what toolchain/packages.sh lists under `system`; network the first time; root, or user namespaces with uidmap.
Example: board/image/build.sh rpi4 --keyring keys/keyring.pem
USAGE
}

installs=() login='' out='' board='' keyring='' flat=0 kernel=build/image/kernel release_file=board/image/release rt=() newer=()
given=("$@")
while (($# > 0)); do
  case $1 in
    virt | rpi4) board=$1 ;;
    --install | --login | --out | --keyring | --release)
      if [[ -z ${2:-} ]]; then
        complain "$1 names nothing" "a typing error" "see board/image/build.sh --help"
        exit 2
      fi
      case $1 in
        --install) installs+=("$(as_called "$2")") ;;
        --login) login=$2 ;;
        --out) out=$(as_called "$2") ;;
        --keyring) keyring=$(as_called "$2") ;;
        --release) release_file=$(as_called "$2") ;;
      esac
      shift
      ;;
    --flat) flat=1 ;;
    --newer) newer=(--newer) ;;
    --rt) kernel=build/image/kernel-rt rt=(--rt) ;;
    --help | -h) usage && exit 0 ;;
    *)
      complain "unknown word '$1'" "a typing error" "see board/image/build.sh --help"
      exit 2
      ;;
  esac
  shift
done
if [[ -z $board ]]; then
  complain "no board" "it was forgotten" "board/image/build.sh rpi4 for a Raspberry Pi 4, virt for the emulated machine"
  exit 2
fi
: "${out:=build/image/$board}"
for dir in "${installs[@]}"; do
  [[ -d $dir ]] && continue
  complain "there is no $dir to install" "it is not built yet" "build the board first, or leave --install out"
  exit 1
done
if [[ -n $keyring ]] && ! openssl x509 -in "$keyring" -noout 2>/dev/null; then
  complain "$keyring is no certificate" "not made yet, or the key was given" "board/image/keys.sh makes one: DIR/keyring.pem"
  exit 1
fi
if [[ -n $keyring && $(grep -c 'BEGIN CERTIFICATE' "$keyring") != $(grep -c 'BEGIN X509 CRL' "$keyring") ]]; then
  complain "$keyring has not a list of revoked signers for each authority" "a certificate alone was given" \
    "give DIR/keyring.pem of board/image/keys.sh; of two authorities, both files one after the other"
  exit 1
fi
if [[ -n $keyring ]] && grep -q 'PRIVATE KEY' "$keyring"; then
  complain "$keyring has a private key in it" "key and certificate in one file" "give the certificate alone: the key must never be on a card"
  exit 1
fi
for tool in depmod modprobe cpio mke2fs mkfs.vfat mcopy mksquashfs veritysetup sfdisk mkimage mkenvimage fdtput jq \
  aarch64-linux-gnu-readelf; do
  command -v "$tool" >/dev/null && continue
  complain "cannot build the image" "$tool is not here" "tests/run.sh --only packages"
  exit 1
done
if [[ ! -x build/rpi4/bin/holdfastd ]]; then
  complain "there is no firmware to put on the card" "the preset rpi4 is not built" \
    "toolchain/sysroot.sh && cmake --preset rpi4 && cmake --build --preset rpi4"
  exit 1
fi
value_of() { sed -n "s/^$1=\([A-Za-z0-9.+~-]*\)\$/\1/p" "$release_file"; }
release=$(value_of release) release_version=$(value_of version) floor=$(value_of floor)
if [[ ! $release =~ ^[0-9]+$ || ! $floor =~ ^[0-9]+$ || -z $release_version ]]; then
  complain "$release_file names no version, release and floor" "it was edited" "see board/image/release"
  exit 1
fi

# Before the namespace: mmdebstrap makes its own. Inside it they find everything there.
board/image/kernel.sh "${rt[@]}" "${newer[@]}"
board/image/base.sh "${newer[@]}"
((flat)) || board/image/firmware.sh "$board" "${newer[@]}"
note_differences sysroot build/sysroot-aarch64/inputs
if ((${#newer[@]} == 0)) && ! is_locked sysroot build/sysroot-aarch64/inputs; then
  complain "holdfastd was built with other libraries than the lock's" "toolchain/sysroot.sh --newer, or a lock that is younger" \
    "toolchain/sysroot.sh && cmake --build --preset rpi4 --clean-first"
  exit 1
fi
while read -r line; do note "tool: $line"; done < <(host_differences)
# Files of the root belong to several users, which only root can make; root of a namespace will do.
if ((EUID != 0)); then
  cd "$called_from"
  exec unshare --user --map-root-user --map-auto -- "$0" "${given[@]}"
fi

# The time of every file that is made here: that of the source, not of the build.
if [[ -z ${SOURCE_DATE_EPOCH:-} ]]; then
  SOURCE_DATE_EPOCH=$(git -c safe.directory="$PWD" log -1 --format=%ct 2>/dev/null) || SOURCE_DATE_EPOCH=1700000000
fi
export SOURCE_DATE_EPOCH
version=$(cat "$kernel/version")
# shellcheck disable=SC2034  # of card.sh
firmware=build/image/firmware-$board
work=$(mktemp -d build/image/work.XXXXXX)
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
started=$SECONDS

# timed WHAT COMMAND...: says how long it took.
timed() {
  local what=$1 start=${EPOCHREALTIME/./} took
  shift
  "$@"
  took=$(((${EPOCHREALTIME/./} - start) / 100000))
  printf 'image: %-28s %3d.%d s\n' "$what" $((took / 10)) $((took % 10))
}

stage_board() {
  cmake --install build/rpi4 --prefix "$work/stage/usr" --component "$board" >"$work/install.log"
  installs=("$work/stage" "${installs[@]}")
}
# A quarter more than the files take, for inodes, journal and what a machine writes.
make_ext4() {
  local size
  size=$(($(du -sm "$work/root" | cut -f 1) * 5 / 4 + 64))
  truncate -s "${size}M" "$work/root.ext4"
  mke2fs -q -F -t ext4 -L holdfast -m 0 -d "$work/root" "$work/root.ext4"
}
# What only a card has: slots, partitions, updates.
install_card() {
  install_tree board/image/card
  mkdir -p "$work/root/boot" "$work/root/data" "$work/root/etc/holdfast" "$work/root/etc/rauc"
  ln -sfn /boot/code "$work/root/etc/holdfast/code"
  sed "s/@board@/$board/" board/image/rauc.conf >"$work/root/etc/rauc/system.conf"
  [[ -z $keyring ]] || install -m 644 "$keyring" "$work/root/etc/rauc/keyring.pem"
  install -m 644 "$release_file" "$work/root/usr/lib/holdfast/release"
}
list_packages() {
  cat build/image/base.inputs "$firmware/inputs" "$kernel/inputs" | LC_ALL=C sort -u >"$work/packages"
}

timed "what the board has" stage_board
timed "unpack Debian" unpack
timed "finish the root" board/image/finish_root.sh "$work/root"
timed "modules, installed files" install_all
timed "initrd" make_initrd
mkdir -p "$out"
if ((flat)); then
  timed "ext4 image" make_ext4
  cp "$kernel/vmlinuz" "$work/vmlinuz"
  mv "$work"/{vmlinuz,initrd.gz,root.ext4} "$out/"
  say "image: $out has kernel $version, root of $(du -m --apparent-size "$out/root.ext4" | cut -f 1) MB ($(du -m "$out/root.ext4" | cut -f 1) MB used)"
  exit 0
fi
timed "what the card has" install_card
timed "root: squashfs, hash tree" make_root_image
timed "kernel, initrd" make_kernel_image
timed "first stages" make_firmware_image
timed "data" make_data_image
timed "card" make_card
list_packages
write_sbom "$(sha256sum "$work/card.img" | cut -d ' ' -f 1)" >"$work/card.spdx.json"
name=$out/holdfast-$board
rm -rf "$out/slot"
mkdir "$out/slot"
mv "$work/root.img" "$work/kernel.img" "$out/slot/"
cp "$work/kernel_files/release" "$out/slot/"
[[ $board != virt ]] || cp "$firmware/u-boot.bin" "$out/"
mv "$work/packages" "$name.packages"
mv "$work/card.spdx.json" "$name.spdx.json"
mv "$work/card.img" "$name.img"
(cd "$out" && sha256sum "holdfast-$board.img" >"holdfast-$board.img.sha256")
sed 's/\t/ /g; s/^/   /' "$name.packages" | cut -d ' ' -f 1-5
say "image: $(wc -l <"$name.packages") packages, listed above and in $name.spdx.json"
say "image: root $(($(stat -c %s "$out/slot/root.img") / 1000000)) MB, kernel and initrd $((($(stat -c %s "$kernel/vmlinuz") + $(stat -c %s "$work/initrd.gz")) / 1000000)) MB"
[[ -n $keyring ]] || note "built without --keyring: this card takes no updates"
[[ -z $login ]] || note "built with --login: whoever reaches $login is root"
say "image: $name.img, $(($(stat -c %s "$name.img") / 1000000)) MB, $(du -m "$name.img" | cut -f 1) MB of it used, release $release ($release_version), in $((SECONDS - started)) s"
say "image: sha256 $(cut -d ' ' -f 1 "$name.img.sha256")"
