#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes the image that the scenarios start from: the board virt as preset rpi4 built it, and tests/system/root over it.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

stage=build/image/stage
rm -rf "$stage"
cmake --install build/rpi4 --prefix "$stage/usr" --component virt
board/image/build.sh --install "$stage" --install tests/system/root
