#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Is every source laid out as .clang-format says? --fix rewrites the files that are not. clang-format 14: other
# versions lay out a few things differently.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=tests/checks/sources.sh
source tests/checks/sources.sh

tool=$(command -v clang-format-14 || command -v clang-format) || {
  echo "error: no clang-format (not installed). Next: apt-get install clang-format, or run tests/run.sh" >&2
  exit 1
}
mapfile -t files < <(our_sources '*.cpp' '*.hpp' '*.c' '*.h')
case ${1:-} in
  '')
    "$tool" --dry-run --Werror --ferror-limit=3 "${files[@]}" || {
      echo "error: sources differ from .clang-format (listed above). Next: tests/checks/format.sh --fix" >&2
      exit 1
    }
    ;;
  --fix) "$tool" -i "${files[@]}" ;;
  *) echo "usage: tests/checks/format.sh [--fix]" >&2 && exit 2 ;;
esac
echo "format: ${#files[@]} files"
