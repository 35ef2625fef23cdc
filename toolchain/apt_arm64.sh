# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# apt for arm64 packages on a host of another architecture: sourced, not run. It keeps its lists, its state and what it
# fetches in a folder of its own, so the host's package database and architectures stay as they are. Needs no root.

# apt_arm64_in DIR: makes the array apt_arm64, the apt-get command that works in DIR, and apt_cache_arm64, its apt-cache.
apt_arm64_in() {
  local dir
  mkdir -p "$1"/{state/lists/partial,cache/archives/partial}
  dir=$(cd "$1" && pwd)
  : >"$dir/state/status"
  local options=(-o "Dir::State=$dir/state" -o "Dir::State::status=$dir/state/status" -o "Dir::Cache=$dir/cache"
    -o APT::Architecture=arm64 -o APT::Architectures=arm64 -o "APT::Sandbox::User=$(id -un)")
  [[ -z ${HOLDFAST_APT_SOURCES:-} ]] || options+=(-o "Dir::Etc::SourceList=$HOLDFAST_APT_SOURCES" -o Dir::Etc::SourceParts=/dev/null)
  # shellcheck disable=SC2034  # for the caller
  apt_arm64=(apt-get -q "${options[@]}") apt_cache_arm64=(apt-cache -q "${options[@]}")
}
