# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# What a card is made of, pinned by board/image/packages.lock: Debian's packages by version and SHA-256. Sourced after say.sh
# and apt_arm64.sh, not run. Whoever fetches packages of a card (base.sh, kernel.sh, firmware.sh, sysroot.sh) does it here,
# in one of three modes:
#   as locked   exactly the lock's packages. One that the archive has replaced, or that has other bytes, is an error
#   newer       what the archive has today; each package that is not the lock's is named in a note. For tests
#   lock        nothing is fetched: the lock's lines, as the archive has them today, on standard output (board/image/lock.sh)
# A row is NAME VERSION ARCHITECTURE SHA256; in the lock each has its group before it. What was fetched stays in build/debs
# under its hash, where the lock's packages are looked for first: kept with a release, that builds it when the archive has
# moved on. HOLDFAST_APT_SOURCES: a sources.list instead of the machine's. HOLDFAST_LOCK: another lock.

lock_file=${HOLDFAST_LOCK:-board/image/packages.lock}
debs=build/debs

# locked GROUP: its rows.
locked() { awk -v group="$1" '$1 == group { print $2, $3, $4, $5 }' "$lock_file"; }

# closure PACKAGE...: NAME=VERSION of these and all that they need, as apt would install them on an empty system.
closure() {
  "${apt_arm64[@]}" -s -o Debug::NoLocking=true --no-install-recommends install "$@" |
    awk '/^Inst / { sub(/^\(/, "", $3); print $2 "=" $3 }'
}

# records [OPTION...] PACKAGE[=VERSION]...: rows of what the archive has of them.
records() {
  { "${apt_cache_arm64[@]}" show "$@" 2>/dev/null || true; } | awk '
    function flush() { if (name != "") print name, version, architecture, hash; name = "" }
    /^Package: / { flush(); name = $2 }
    /^Version: / { version = $2 }
    /^Architecture: / { architecture = $2 }
    /^SHA256: / { hash = $2 }
    END { flush() }' | LC_ALL=C sort -u
}

# inputs DEB...: one line each for the list of what was taken: name, version, architecture, source, kB, SHA-256.
inputs() {
  local deb
  for deb in "$@"; do
    # shellcheck disable=SC2016  # dpkg-deb's own fields
    dpkg-deb -W --showformat='${Package}\t${Version}\t${Architecture}\t${source:Package} ${source:Version}\t${Installed-Size}\t' "$deb"
    sha256sum "$deb" | cut -d ' ' -f 1
  done | LC_ALL=C sort
}

# differences GROUP FILE: what the list FILE (of inputs) has otherwise than the lock, a line each; nothing: it is the lock's.
differences() {
  awk -v group="$1" '
    NR == FNR { if ($1 == group) { version[$2] = $3; hash[$2] = $5 } next }
    { split($0, f, "\t"); here[f[1]] = 1 }
    !(f[1] in version) { print f[1] " " f[2] " is not in the lock"; next }
    version[f[1]] != f[2] { print f[1] " " f[2] " instead of " version[f[1]]; next }
    hash[f[1]] != f[6] { print f[1] " " f[2] " with other bytes than the lock says" }
    END { for (name in version) if (!(name in here)) print name " " version[name] " is missing" }' \
    "$lock_file" "$2" | LC_ALL=C sort
}

# is_locked GROUP FILE; note_differences GROUP FILE: names them, and is always content.
is_locked() { [[ -s $2 && -z $(differences "$1" "$2") ]]; }
note_differences() {
  local line
  while read -r line; do note "not as locked: $line"; done < <(differences "$1" "$2")
}

# The tools of this machine whose version decides over a card's bytes.
host_tools=(binutils-aarch64-linux-gnu g++-12-aarch64-linux-gnu gcc-12-aarch64-linux-gnu libc6-dev-arm64-cross
  libgcc-12-dev-arm64-cross libstdc++-12-dev-arm64-cross cpio cryptsetup-bin device-tree-compiler dosfstools e2fsprogs fdisk gzip
  kmod libzstd1 mmdebstrap mtools squashfs-tools u-boot-tools)

# host_rows: the lock's lines of them, as this machine's package lists have them. host_differences: which are others here.
host_rows() {
  local -a apt_cache_arm64=(apt-cache)
  records --no-all-versions "${host_tools[@]}" | sed 's/^/host /'
}
host_differences() {
  local name version here
  while read -r name version _; do
    # shellcheck disable=SC2016  # dpkg-query's own fields
    here=$(dpkg-query -W -f '${Version}' "$name" 2>/dev/null) || here="not installed"
    [[ $here == "$version" ]] || say "$name is $here, locked is $version"
  done < <(locked host)
}

# fetch GROUP DIR MODE WORD...: the packages NAME or NAME=VERSION (mode newer), or the lock's (mode locked, whatever the
# words are), as DIR/NAME_VERSION_ARCHITECTURE.deb. Mode lock: the lock's lines instead. After apt_arm64_in and an update.
fetch() {
  local group=$1 dir=$2 mode=$3 rows name version architecture hash deb has
  local -a ask=() missing=()
  shift 3
  mkdir -p "$dir" "$debs"
  if [[ $mode == locked ]]; then rows=$(locked "$group"); else rows=$(records --no-all-versions "$@"); fi
  if [[ -z $rows ]]; then
    complain "there are no packages of group $group" "no network, or the lock is of before" "see the lines above, or board/image/lock.sh"
    return 1
  fi
  if [[ $mode == lock ]]; then
    sed "s/^/$group /" <<<"$rows"
    return
  fi
  # shellcheck disable=SC2046  # names
  has=$(records $(cut -d ' ' -f 1 <<<"$rows"))
  while read -r name version architecture hash; do
    [[ ! -f $debs/$hash.deb ]] || continue
    if grep -qxF "$name $version $architecture $hash" <<<"$has"; then
      ask+=("$name=$version")
    else
      grep -q "^$name $version " <<<"$has" && missing+=("$name $version has other bytes there") && continue
      missing+=("$name $version is $(grep -F "$name " <<<"$has" | cut -d ' ' -f 2 | tr '\n' ' ')there")
    fi
  done <<<"$rows"
  if ((${#missing[@]})); then
    for name in "${missing[@]}"; do say "   not in the archive as locked: $name"; done
    complain "${#missing[@]} packages of the lock are not to be had: ${missing[0]}" "Debian has replaced them" \
      "board/image/lock.sh locks what is there now; a release of before: give build/debs that were kept with it, or HOLDFAST_APT_SOURCES; a test: --newer"
    return 1
  fi
  rm -rf "$dir/.new"
  mkdir "$dir/.new"
  if ((${#ask[@]})) && ! quietly "$dir/.download.log" env -C "$dir/.new" "${apt_arm64[@]}" download "${ask[@]}"; then
    complain "cannot fetch ${ask[*]}" "no network, or the archive changed just now" "see the lines above, then try again"
    return 1
  fi
  for deb in "$dir/.new"/*.deb; do
    [[ ! -f $deb ]] || mv "$deb" "$debs/$(sha256sum "$deb" | cut -d ' ' -f 1).deb"
  done
  while read -r name version architecture hash; do
    deb=$debs/$hash.deb
    if [[ ! -f $deb || $(sha256sum "$deb" | cut -d ' ' -f 1) != "$hash" ]]; then
      rm -f "$deb"
      complain "$name $version has other bytes than its SHA-256" "a damaged copy, or an archive that is not Debian's" "try again; then look at the package source"
      return 1
    fi
    cp "$deb" "$dir/${name}_${version//:/%3a}_$architecture.deb"
  done <<<"$rows"
  rm -rf "$dir/.new" "$dir/.download.log"
}
