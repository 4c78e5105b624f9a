# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# Completion in bash of citylearn, its programs and ./run. In the repository: `. tools/citylearn/completion/citylearn.bash`.

_citylearn() {
  local words=("${COMP_WORDS[@]:1:COMP_CWORD}") kept=() word current program=citylearn
  for word in "${words[@]}"; do [ "$word" = = ] || kept+=("$word"); done   # --seed=1 is three words to bash
  current=${words[-1]}
  [ "$current" != = ] || { current=''; kept+=(''); }
  case ${COMP_WORDS[0]##*/} in
    citylearn|run) program=${COMP_WORDS[0]} ;;
    *) kept=("${COMP_WORDS[0]##*/}" "${kept[@]}") ;;
  esac
  mapfile -t COMPREPLY < <(compgen -W "$("$program" complete "${kept[@]}" 2>/dev/null)" -- "$current")
}

complete -o bashdefault -o default -F _citylearn citylearn ./run env_service encoder_service policy_service dashboard \
  citylearn_data citylearn_doctor citylearn_paper citylearn_record citylearn_replay citylearn_vpr
