#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The digest of the recordings (digest.cpp) with compilers and levels that no preset uses, each compared with digest.txt:
#   tests/checks/digest_matrix.sh [COMMAND...]      such as "g++ -O0" "clang++-14 -O2"; default: the list below
# Processors other than the host's run under qemu-user and need toolchain/sysroot.sh. One compiler at a time: a minute
# for each command. Objects are in build/digest.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
sysroot=$PWD/build/sysroot-aarch64 triplet=aarch64-linux-gnu
aarch64="$triplet-g++ -isystem $sysroot/usr/include -isystem $sysroot/usr/include/$triplet -isystem $sysroot/usr/include/opencv4"

if (($# > 0)); then
  commands=("$@")
else
  commands=("g++ -O0" "g++ -O1" "g++ -O2" "g++ -O3" "g++ -Os" "g++ -O3 -march=native" "clang++-14 -O0" "clang++-14 -O2"
    "clang++-14 -O3" "$triplet-g++ -O2" "$triplet-g++ -O3 -mcpu=cortex-a72")
fi
mapfile -t sources < <(find firmware -name '*.cpp' -not -name main.cpp | sort)
sources+=(drivers/common/jpeg_turbo.cpp tests/checks/digest.cpp)

status=0
for command in "${commands[@]}"; do
  objects=build/digest/${command//[^a-z0-9A-Z]/_}
  mkdir -p "$objects"
  emulator=()
  compile="$command -isystem /usr/include/opencv4" jpeg=-ljpeg
  if [[ $command == "$triplet"-* ]]; then
    compile="$aarch64 ${command#* }" jpeg=$sysroot/usr/lib/$triplet/libjpeg.so
    emulator=(qemu-aarch64 -L "/usr/$triplet" -E "LD_LIBRARY_PATH=$sysroot/usr/lib/$triplet")
  fi
  read -ra compile <<<"$compile -std=c++20 -DNDEBUG -DHOLDFAST_VERSION=\"digest\" -Ifirmware -I."
  for source in "${sources[@]}"; do
    object=$objects/${source//\//_}.o
    "${compile[@]}" -c "$source" -o "$object"
  done
  # Named, not looked for: the sysroot has a libc of its own as well.
  "${compile[@]}" "$objects"/*.o "$jpeg" -o "$objects/digest"
  start=$SECONDS
  if "${emulator[@]}" "$objects/digest" tests/checks/digest.txt >"$objects/digest.log"; then
    echo "$command: the same, in $((SECONDS - start)) s"
  else
    status=1
    cat "$objects/digest.log"
    echo "error: $command: another digest (see above)"
  fi
done
exit "$status"
