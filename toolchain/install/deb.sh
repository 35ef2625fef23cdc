#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The Debian package of the host tool and the firmware on a simulated board, for this machine's release and processor.
#   toolchain/install/deb.sh [--check] [BUILD_DIR]      default build/sim, built; the package is made in BUILD_DIR
# --check: then lintian, and the package in a fresh root of the same release, where it plays a scene (mmdebstrap,
# network, root).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
check=0
[[ ${1:-} != --check ]] || { check=1 && shift; }
build=${1:-build/sim}
[[ -x $build/bin/holdfast ]] || { complain "no $build/bin/holdfast" "not built" "cmake --workflow --preset sim" && exit 1; }
for tool in help2man dpkg-shlibdeps fakeroot; do
  command -v "$tool" >/dev/null || { complain "no $tool" "not installed" "tests/run.sh --only packages, or apt-get install help2man dpkg-dev fakeroot" && exit 1; }
done
ninja -C "$build" man_pages >/dev/null
rm -f "$build"/holdfast_*.deb
umask 022
quietly "$build/cpack.log" cpack --config "$build/CPackConfig.cmake" -B "$build"
deb=$(ls "$build"/holdfast_*.deb)
say "$deb: $(stat -c %s "$deb") bytes, $(dpkg-deb -f "$deb" Architecture)"
((check == 1)) || exit 0

# No release is uploaded to Debian, so no bug closes; and the changelog is a table of what a user notices.
lintian --fail-on error,warning --suppress-tags initial-upload-closes-no-bugs,syntax-error-in-debian-changelog "$deb"
say "lintian: no error and no warning"
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
release=$(. /etc/os-release && echo "$VERSION_CODENAME")
cp "$deb" "$root.deb"
quietly "$build/root.log" mmdebstrap --variant=minbase --include=ca-certificates "$release" "$root" \
  --customize-hook="cp $root.deb \$1/tmp/holdfast.deb" \
  --customize-hook='chroot "$1" apt-get install -y --no-install-recommends /tmp/holdfast.deb'
rm -f "$root.deb"
in_root() { chroot "$root" env -i PATH=/usr/bin:/bin HOME=/root "$@"; }
in_root holdfast --version
in_root holdfast sim /usr/share/holdfast/scenes/relief_slip_20_mm_s.json --report /tmp/slip.html >"$build/root.log"
grep '^slip' "$build/root.log"
in_root holdfastd --play /usr/share/holdfast/scenes/relief_slip_20_mm_s.json --seconds 2.2 >"$build/root.log"
grep -m 1 'SLIP' "$build/root.log"
in_root holdfast record /tmp/a.mcap --play /usr/share/holdfast/scenes/relief_slip_20_mm_s.json --seconds 1 | tail -n 1
say "a fresh root of $release installs and runs it"
