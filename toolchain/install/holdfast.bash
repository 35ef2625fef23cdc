# SPDX-License-Identifier: Apache-2.0
# bash completion for holdfast: commands and options as --help names them, else files.
_holdfast() {
  local word=${COMP_WORDS[COMP_CWORD]} before=() i
  for ((i = 1; i < COMP_CWORD; ++i)); do
    [[ ${COMP_WORDS[i]} == [a-z]* ]] || break
    before+=("${COMP_WORDS[i]}")
  done
  local help
  help=$(holdfast "${before[@]:0:2}" --help 2>/dev/null) || help=$(holdfast "${before[@]:0:1}" --help 2>/dev/null)
  local options commands
  options=$(grep -oE -- '--[a-z][a-z-]*' <<<"$help" | sort -u)
  commands=$(sed -n '/^Subcommands:/,/^$/s/^  \([a-z]*\) .*/\1/p' <<<"$help")
  if [[ $word == -* ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$options" -- "$word")
  elif [[ -n $commands ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$commands" -- "$word")
  else
    compopt -o filenames 2>/dev/null
    mapfile -t COMPREPLY < <(compgen -f -- "$word")
  fi
}
complete -F _holdfast holdfast
