# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# The Debian packages that Holdfast needs, and ensure_packages, which installs what is missing. Sourced, not run.
# The versions are those of Debian 12 (bookworm) that the project is known to work with. Another version is a note,
# never an error: point releases change them. And how many jobs a build has at once.

# shellcheck source=toolchain/say.sh
source "$(dirname "${BASH_SOURCE[0]}")/say.sh"

# ninja would begin two jobs more than there are cores, which takes a ninth longer on two (2026-11-27).
export CMAKE_BUILD_PARALLEL_LEVEL=${CMAKE_BUILD_PARALLEL_LEVEL:-$(nproc)}

# GROUP PACKAGE VERSION. build: firmware, simulator and tool; test: tests and checks on the host; lint: clang-tidy and
# coverage; cross: aarch64 and its emulator; system: the cards, and the emulated machine that starts from one; bench:
# models of processors (tests/bench/board_time.sh); fuzz: libFuzzer; deb: the tool as a Debian package, tried in a fresh
# root; cluster: a Slurm of one machine (tests/e2e/cluster.sh), only with --all or --long; web: the browser that the page
# of a session is shown in.
package_table() {
  cat <<'TABLE'
build g++ 4:12.2.0-3
build cmake 3.25.1-1
build ninja-build 1.11.1-2~deb12u1
build pkg-config 1.8.1-1
build libopencv-core-dev 4.6.0+dfsg-12
build libopencv-imgproc-dev 4.6.0+dfsg-12
build libopencv-imgcodecs-dev 4.6.0+dfsg-12
build libopencv-videoio-dev 4.6.0+dfsg-12
build libopencv-ml-dev 4.6.0+dfsg-12
build libopencv-features2d-dev 4.6.0+dfsg-12
build libopencv-video-dev 4.6.0+dfsg-12
build libavformat-dev 7:5.1.9-0+deb12u1
build libjpeg62-turbo-dev 1:2.1.5-2
build libcli11-dev 2.1.2+ds-1
build libfmt-dev 9.1.0+ds1-2
build nlohmann-json3-dev 3.11.2-2
build libcamera-dev 0.0.3-6
build libgpiod-dev 1.6.3-1+b3
build libhidapi-dev 0.13.1-1
build libusb-1.0-0-dev 2:1.0.26-1
build libsodium-dev 1.0.18-1+deb12u1
build libcpp-httplib-dev 0.11.4+ds-1+deb12u1
build zlib1g-dev 1:1.2.13.dfsg-1
build libtomlplusplus-dev 3.3.0+ds-1
test ccache 4.8+really4.7.5-1
test libcpputest-dev 4.0-2
test libmodbus-dev 3.1.6-2.1+deb12u1
test clang-format 1:14.0-55.7~deb12u1
test valgrind 1:3.19.0-1
test tmux 3.3a-3
test picocom 3.1-4
test fdisk 2.38.1-5+deb12u3
test xz-utils 5.4.1-1
test zstd 1.5.4+dfsg2-5
bench llvm-19 1:19.1.7-3~deb12u1
test python3 3.11.2-1+b1
test python3-numpy 1:1.24.2-1+deb12u1
test python3-pip 23.0.1+dfsg-1
test libmosquitto-dev 2.0.11-1.2+deb12u2
test mosquitto 2.0.11-1.2+deb12u2
test mosquitto-clients 2.0.11-1.2+deb12u2
test prometheus-mqtt-exporter 0.1.7-1+b4
test cyclonedds-dev 0.10.2-2
test cyclonedds-tools 0.10.2-2
test libfastrtps-dev 2.9.1+ds-1+deb12u2
test libfastcdr-dev 1.0.26-1
test ament-cmake 1.5.2-2
test rosidl-cmake 3.3.1-1
test rosidl-generator-c-cpp 3.3.1-1
test rosidl-tools 3.3.1-1
test openssl 3.0.19-1~deb12u2
test curl 7.88.1-10+deb12u14
test rauc 1.8-2
test squashfs-tools 1:4.5.1-1
test jq 1.6-2.1+deb12u1
lint clang-tidy 1:14.0-55.7~deb12u1
lint gcovr 5.2-1
fuzz clang-14 1:14.0.6-12
fuzz libclang-rt-14-dev 1:14.0.6-12
cross g++-aarch64-linux-gnu 4:12.2.0-3
cross qemu-user 1:7.2+dfsg-7+deb12u18+b3
cross qemu-user-static 1:7.2+dfsg-7+deb12u18+b3
system qemu-system-arm 1:7.2+dfsg-7+deb12u18+b3
system mmdebstrap 1.3.5-7
system arch-test 0.20-1
system libusbredirparser-dev 0.13.0-2
system e2fsprogs 1.47.0-2+b2
system kmod 30+20221128-1
system cpio 2.13+dfsg-7.1
system dosfstools 4.2-1
system mtools 4.0.33-1+really4.0.32-1
system fdisk 2.38.1-5+deb12u3
system squashfs-tools 1:4.5.1-1
system cryptsetup-bin 2:2.6.1-4~deb12u2
system u-boot-tools 2023.01+dfsg-2+deb12u3
system device-tree-compiler 1.6.1-4+b1
system jq 1.6-2.1+deb12u1
system rauc 1.8-2
system openssl 3.0.19-1~deb12u2
system file 1:5.44-3
deb help2man 1.49.3
deb lintian 2.116.3+deb12u1
deb dpkg-dev 1.21.23
deb fakeroot 1.31-1.2
deb mmdebstrap 1.3.5-7
cluster slurmctld 22.05.8-4+deb12u3
cluster slurmd 22.05.8-4+deb12u3
cluster slurm-client 22.05.8-4+deb12u3
cluster munge 0.5.15-2+deb12u1
web chromium 156.0.8078.79-1~deb12u1
TABLE
}

# name_here PACKAGE: what this system calls it. Ubuntu (24.04; not tried) has one library under another name.
name_here() {
  case $(. /etc/os-release 2>/dev/null && printf %s "${ID:-}"):$1 in
    ubuntu:libjpeg62-turbo-dev) echo libjpeg-turbo8-dev ;;
    *) echo "$1" ;;
  esac
}

# ensure_packages GROUP...: installs the packages of the groups that are missing; touches nothing when none is.
ensure_packages() {
  local groups=" $* " group package wanted installed
  local -a missing=() others=()
  if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
    complain "cannot look for packages" "this is not a Debian machine: apt-get or dpkg-query is not here" \
      "use Debian 12, or install what $(basename "${BASH_SOURCE[0]}") lists by hand"
    return 1
  fi
  while read -r group package wanted; do
    [[ $groups == *" $group "* ]] || continue
    package=$(name_here "$package")
    # shellcheck disable=SC2016  # dpkg-query's own fields
    installed=$(dpkg-query -W -f '${db:Status-Status} ${Version}\n' "$package" 2>/dev/null |
      awk '$1 == "installed" { print $2; exit }')
    if [[ -z $installed ]]; then
      missing+=("$package")
    elif [[ $installed != "$wanted" ]]; then
      others+=("$package $installed (known to work: $wanted)")
    fi
  done <<<"$(package_table)"

  for package in "${others[@]}"; do note "$package"; done
  if ((${#missing[@]} == 0)); then
    say "packages ($*): all installed"
    return 0
  fi
  say "packages ($*): installing ${missing[*]}"

  local -a root=()
  if ((EUID != 0)); then
    if ! command -v sudo >/dev/null; then
      complain "cannot install ${missing[*]}" "not root, and sudo is not here" \
        "as root: apt-get install --no-install-recommends ${missing[*]}"
      return 1
    fi
    root=(sudo)
    [[ -t 0 ]] || root=(sudo -n)
  fi
  local -a apt=("${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=600 -y)
  local -a install=("${apt[@]}" --no-install-recommends install "${missing[@]}")
  local log
  log=$(mktemp)
  # A fresh machine has no package lists and an old one has stale lists: both show as a failed first try.
  if ! "${install[@]}" >"$log" 2>&1 </dev/null; then
    say "packages: refreshing the package lists"
    if ! "${apt[@]}" update >"$log" 2>&1 </dev/null || ! "${install[@]}" >>"$log" 2>&1 </dev/null; then
      tail -n 15 "$log" | sed 's/^/   | /' >&2
      rm -f "$log"
      complain "apt-get could not install ${missing[*]}" "no network, no rights, or no Debian 12 package source" \
        "see the lines above, then: apt-get update && apt-get install --no-install-recommends ${missing[*]}"
      return 1
    fi
  fi
  rm -f "$log"
  say "packages ($*): installed ${#missing[@]}"
}
