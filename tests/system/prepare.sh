#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes the image that the scenarios start from: the board virt as preset rpi4 built it, and tests/system/root over it.
set -euo pipefail
PATH=$PATH:/usr/sbin:/sbin  # mke2fs
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

stage=build/image/stage
rm -rf "$stage"
cmake --install build/rpi4 --prefix "$stage/usr" --component virt
# The HAL's contract is run on the machine's real devices, too.
mkdir -p "$stage/usr/lib/holdfast"
cp build/rpi4/bin/firmware_tests "$stage/usr/lib/holdfast/"
# A disk that a scenario makes stand still.
mke2fs -q -F -t ext4 -O ^has_journal "$stage/usr/lib/holdfast/disk.ext4" 2M
board/image/build.sh --install "$stage" --install tests/system/root
