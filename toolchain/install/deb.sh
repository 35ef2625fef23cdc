#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The Debian package of the host tool and the firmware on a simulated board.
#   toolchain/install/deb.sh [--check] [BUILD_DIR]      for this machine's release; default build/sim, built
#   toolchain/install/deb.sh --release trixie [--check] [DIR]
#                                                       for another one, built in a root of it from what is committed,
#                                                       without the device libraries; default build/RELEASE
#   toolchain/install/deb.sh --arch arm64 [--check] [DIR]
#                                                       for this release and arm64, by the cross compiler, after this
#                                                       machine's in build/sim, whose dependencies and pages it takes
#                                                       over; default build/tool-arm64. Needs network, no root
# The package is in the folder. --check: then lintian, and the package in a fresh root of the release, where it plays a
# scene. Both kinds of root need mmdebstrap, network, root. That of arm64 has what the package depends on unpacked, not
# configured, and qemu-user runs the programs.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/packages.sh
source toolchain/packages.sh
# shellcheck source=toolchain/apt_arm64.sh
source toolchain/apt_arm64.sh
# shellcheck source=toolchain/locked.sh
source toolchain/locked.sh
check=0 release='' arch='' build=''
while (($# > 0)); do
  case $1 in
    --check) check=1 ;;
    --release)
      [[ ${2:-} =~ ^[a-z]+$ ]] || { complain "--release '${2:-}' is no name" "a typing error" "give one as trixie" && exit 2; }
      release=$2
      shift
      ;;
    --arch)
      [[ ${2:-} == arm64 ]] || { complain "--arch '${2:-}' is not arm64" "a typing error" "leave it out for this machine's" && exit 2; }
      arch=$2
      shift
      ;;
    -*) complain "unknown option '$1'" "a typing error" "see the head of $0" && exit 2 ;;
    *) build=$1 ;;
  esac
  shift
done
umask 022
work=$(mktemp -d)
# What is mounted in it must not be deleted with it.
trap 'umount "$work/root/dev" "$work/root/proc" 2>/dev/null || true; rm -rf --one-file-system "$work"' EXIT

# in_root ROOT COMMAND...
in_root() {
  local root=$1
  shift
  chroot "$root" env -i PATH=/usr/bin:/bin:/usr/sbin:/sbin HOME=/root LC_ALL=C.UTF-8 "$@"
}

# unpack ROOT PACKAGE...: these of arm64 and all that they need, in ROOT. Links that name a place from / do so from ROOT.
unpack() {
  local root=$1 link name all
  shift
  mapfile -t all < <(closure "$@" | grep -v '^holdfast=')
  mkdir -p "$root" "$work/debs"
  root=$(cd "$root" && pwd)
  (cd "$work/debs" && quietly "$top/$build/download.log" "${apt_arm64[@]}" download "${all[@]}")
  for name in "${all[@]}"; do dpkg-deb -x "$work/debs/${name%%=*}"_*.deb "$root"; done
  find "$root" -type l -lname '/*' | while read -r link; do ln -sfn "$root$(readlink "$link")" "$link"; done
}
# emulated ROOT PROGRAM ARGUMENT...: by qemu-user, with what is in ROOT. What update-alternatives links is found by path.
emulated() {
  local libraries=/usr/lib/aarch64-linux-gnu
  qemu-aarch64 -L "$1" -E LD_LIBRARY_PATH="$libraries/blas:$libraries/lapack" "${@:2}"
}

top=$PWD
if [[ -n $arch ]]; then
  build=${build:-build/tool-arm64}
  mkdir -p "$build"
  toolchain/install/deb.sh
  apt_arm64_in "$work"
  quietly "$build/update.log" "${apt_arm64[@]}" update
  sysroot=$top/$build/sysroot
  if [[ ! -f $sysroot/packages.txt ]]; then
    rm -rf "$sysroot"
    mapfile -t needed < <(package_table | awk '$1 == "build" && $2 ~ /-dev$/ { print $2 }')
    unpack "$sysroot" "${needed[@]}"
    printf '%s\n' "${needed[@]}" >"$sysroot/packages.txt"
  fi
  # What libraries of others want of libraries that update-alternatives would link is not this linker's business.
  quietly "$build/configure.log" env LDFLAGS=-Wl,--unresolved-symbols=ignore-in-shared-libs cmake --preset sim -B "$build" \
    -DCMAKE_TOOLCHAIN_FILE="$top/toolchain/aarch64-linux-gnu.cmake" -DHOLDFAST_SYSROOT="$sysroot" -DHOLDFAST_CPU=generic \
    -DBUILD_TESTING=OFF -DCPACK_DEBIAN_PACKAGE_ARCHITECTURE="$arch" -DCPACK_DEBIAN_PC_PACKAGE_DEPENDS="$(dpkg-deb -f build/sim/holdfast_*.deb Depends)"
  quietly "$build/build.log" ninja -C "$build" holdfast holdfastd holdfast-sensor
  rm -rf "$build/man" "$build"/holdfast_*.deb
  cp -r build/sim/man "$build/man"  # the programs say the same
  quietly "$build/cpack.log" cpack --config "$build/CPackConfig.cmake" -B "$build"
elif [[ -n $release ]]; then
  build=${build:-build/$release}
  mkdir -p "$build" "$work/root"
  # libcamera, libgpiod, hidapi and libusb are left out: the tool goes without.
  needed=$(package_table | awk '$1 == "build" && $2 !~ /^lib(camera|gpiod|hidapi|usb-1.0-0)-dev$/ { print $2 }' | paste -sd,)
  quietly "$build/root.log" mmdebstrap --variant=minbase --include="$needed,help2man,dpkg-dev,fakeroot,file" "$release" "$work/root"
  mkdir "$work/root/src"
  git archive HEAD | tar -x -C "$work/root/src"
  mount --bind /dev "$work/root/dev"
  # shellcheck disable=SC2016  # the root's shell
  quietly "$build/build.log" in_root "$work/root" bash -c 'cd /src && cmake -G Ninja -B build/sim -DCMAKE_BUILD_TYPE=Release \
    -DBUILD_TESTING=OFF && ninja -C build/sim holdfast holdfastd && toolchain/install/deb.sh'
  umount "$work/root/dev"
  rm -f "$build"/holdfast_*.deb
  cp "$work"/root/src/build/sim/holdfast_*.deb "$build"
  rm -rf --one-file-system "$work/root"
else
  build=${build:-build/sim}
  [[ -x $build/bin/holdfast ]] || { complain "no $build/bin/holdfast" "not built" "cmake --workflow --preset sim" && exit 1; }
  for tool in help2man dpkg-shlibdeps fakeroot; do
    command -v "$tool" >/dev/null || { complain "no $tool" "not installed" "tests/run.sh --only packages, or apt-get install help2man dpkg-dev fakeroot" && exit 1; }
  done
  ninja -C "$build" man_pages >/dev/null
  rm -f "$build"/holdfast_*.deb
  quietly "$build/cpack.log" cpack --config "$build/CPackConfig.cmake" -B "$build"
fi
deb=$(ls "$build"/holdfast_*.deb)
say "$deb: $(stat -c %s "$deb") bytes, $(dpkg-deb -f "$deb" Architecture)"
((check == 1)) || exit 0

# No release is uploaded to Debian, so no bug closes; and the changelog is a table of what a user notices.
lintian --fail-on error,warning --suppress-tags initial-upload-closes-no-bugs,syntax-error-in-debian-changelog "$deb"
say "lintian: no error and no warning"
if [[ -n $arch ]]; then
  # apt finds all that it depends on, for arm64; and the programs run with that and nothing else.
  unpack "$work/root" "$(realpath "$deb")"
  dpkg-deb -x "$deb" "$work/root"
  readelf -h "$work/root/usr/bin/holdfast" | grep AArch64
  scene=$work/root/usr/share/holdfast/scenes/relief_slip_20_mm_s.json
  emulated "$work/root" "$work/root/usr/bin/holdfast" --version
  emulated "$work/root" "$work/root/usr/bin/holdfast" sim "$scene" --report "$work/slip.html" >"$build/run.log"
  grep '^slip' "$build/run.log"
  emulated "$work/root" "$work/root/usr/bin/holdfastd" --play "$scene" --seconds 2.2 >"$build/run.log"
  grep -m 1 'SLIP' "$build/run.log"
  say "what it depends on and qemu-user run it"
  exit 0
fi
release=${release:-$(. /etc/os-release && echo "$VERSION_CODENAME")}
cp "$deb" "$work/holdfast.deb"
quietly "$build/root.log" mmdebstrap --variant=minbase --include=ca-certificates "$release" "$work/root" \
  --customize-hook="cp $work/holdfast.deb \$1/tmp/holdfast.deb" \
  --customize-hook='chroot "$1" apt-get install -y --no-install-recommends /tmp/holdfast.deb'
mount --bind /proc "$work/root/proc"  # as on every machine: a program finds its folder there
in_root "$work/root" holdfast --version
in_root "$work/root" holdfast sim /usr/share/holdfast/scenes/relief_slip_20_mm_s.json --report /tmp/slip.html >"$build/root.log"
grep '^slip' "$build/root.log"
in_root "$work/root" holdfastd --play /usr/share/holdfast/scenes/relief_slip_20_mm_s.json --seconds 2.2 >"$build/root.log"
grep -m 1 'SLIP' "$build/root.log"
in_root "$work/root" holdfast record /tmp/a.mcap --play /usr/share/holdfast/scenes/relief_slip_20_mm_s.json --seconds 1 | tail -n 1
say "a fresh root of $release installs and runs it"
