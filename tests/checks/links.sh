#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Does every relative link of the documents lead to something, every anchor to a heading, and is README.md short? Also:
# a document that a source names in capitals (DESIGN.md, LINK.md) has to be in the tree.
#   links.sh [DOCUMENT...]     all documents of the tree unless some are named
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
most_readme_lines=130

all() { find . \( -name build -o -name node_modules -o -name .git \) -prune -o -name '*.md' -print | sort; }
mapfile -t documents < <(if (($# > 0)); then printf '%s\n' "$@"; else all; fi)

# anchors FILE: one a line, as GitHub makes them of headings.
anchors() {
  awk '
    /^ *```/ { code = !code }
    code || !/^#+ / { next }
    {
      sub(/^#+ +/, "")
      gsub(/\]\([^)]*\)/, "")
      $0 = tolower($0)
      gsub(/[^a-z0-9 _-]/, "")
      gsub(/ /, "-")
      print seen[$0]++ ? $0 "-" (seen[$0] - 1) : $0
    }' "$1"
}

# links FILE: "LINE TARGET" of each link that is not in code.
links() {
  awk '
    /^ *```/ { code = !code }
    code || /^    / { next }
    {
      gsub(/`[^`]*`/, "")
      while (match($0, /\]\([^) ]+\)/)) {
        print FNR, substr($0, RSTART + 2, RLENGTH - 3)
        $0 = substr($0, RSTART + RLENGTH)
      }
    }' "$1"
}

status=0 count=0
broken() {
  complain "$1:$2: the link $3 leads nowhere" "$4 was renamed or went" "give the name that it has now"
  status=1
}
for document in "${documents[@]}"; do
  while read -r line target; do
    [[ $target != *://* && $target != mailto:* ]] || continue
    count=$((count + 1))
    path=${target%%#*} anchor=''
    [[ $target != *'#'* ]] || anchor=${target#*#}
    file=$document
    [[ -z $path ]] || file=$(dirname "$document")/$path
    if [[ ! -e $file ]]; then
      broken "$document" "$line" "$target" "the file"
    elif [[ -n $anchor ]] && ! anchors "$file" | grep -qxF -- "$anchor"; then
      broken "$document" "$line" "$target" "the heading"
    fi
  done < <(links "$document")
done

if (($# == 0)); then
  lines=$(wc -l <README.md)
  if ((lines > most_readme_lines)); then
    complain "README.md has $lines lines, and may have $most_readme_lines" "something was added that belongs beside what it describes" \
      "move it there and link to it"
    status=1
  fi
  names=$(printf '%s\n' "${documents[@]##*/}")
  while IFS=: read -r source name; do
    grep -qxF -- "$name" <<<"$names" || {
      complain "$source names $name, which is not in the tree" "it was renamed or went" "name the one that says it now"
      status=1
    }
  done < <(grep -rHowE '[A-Z_]{3,}\.md' firmware hal drivers board toolchain tests --include='*.cpp' --include='*.hpp' --include='*.[ch]' \
    --include='*.sh' --include='CMakeLists.txt' --include='*.js' --exclude-dir=node_modules --exclude-dir=build | sort -u)
fi
((status == 0)) || exit 1
say "links: $count in ${#documents[@]} documents"
