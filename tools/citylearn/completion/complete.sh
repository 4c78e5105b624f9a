# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# The hidden command `complete`, which shells ask while a command line is typed. All it says comes from the programs: options
# from their help, names from their --list. commands.sh reads this file.

# Prints the help of the command $1 or the subcommand $2 of its program.
help_of() {
  local path subcommand=()
  path=$(program "$1")
  [ -z "$2" ] || subcommand=("$2")
  "$path" "${subcommand[@]}" --help-all 2>/dev/null || "$path" "${subcommand[@]}" --help 2>/dev/null || true
}

# Prints what the --list of the services has under the headings that name the option $1: networks for --agent.
listed_names() {
  local command
  for command in env encoder policy; do
    "$(program "$command")" --list 2>/dev/null || true
  done | awk -v option="$1" '/^[^ ]/ { inside = index($0 " ", option ")") || index($0, option ",") || index($0, option " ") }
    inside && /^  [a-z]/ { print $1 }' | sort -u
}

# Prints what may be the last of the words $@, which follow the command's name, one a line. Prints nothing where a file or a
# free text is meant.
completions() {
  [ $# -gt 1 ] || { printf '%s\n' "${COMMANDS[@]}"; return; }
  local command=$1 words=("${@:2:$#-2}") current=${!#} name text='' values subcommands=() subcommand=''
  for name in "${!PROGRAMS[@]}"; do
    [ "$command" != "${PROGRAMS[$name]##*/}" ] || command=$name   # a program by its own name
  done
  case $command in
    demo|again)
      # It passes on what it does not know: parameters of datasets and encoders, and all options of the policy_service.
      . "$PARTS/demo.sh"
      text=$(demo_usage | grep -o -e '--[a-z-]*' | sed 's/^/  /'
             for name in env encoder; do "$(program "$name")" --list 2>/dev/null || true; done | sed -n 's/^      --/  --/p'
             help_of policy '') ;;
    robot)
      . "$PARTS/robot.sh"
      text=$(robot_usage | grep -o -e '--[a-z-]*' | sed 's/^/  /') ;;
    *)
      [ -n "${PROGRAMS[$command]:-}" ] || return 0
      text=$(help_of "$command" '')
      mapfile -t subcommands < <(sed -n '/^Subcommands:/,$ s/^  \([a-z]\+\) .*/\1/p' <<<"$text")
      for name in "${subcommands[@]}"; do [ "${words[0]:-}" != "$name" ] || subcommand=$name; done
      [ -z "$subcommand" ] || text=$(help_of "$command" "$subcommand") ;;
  esac
  if [ ${#words[@]} -gt 0 ] && [[ ${words[-1]} == --* ]]; then
    local taken
    taken=$(sed -nE "s/^  (-[a-z],)?${words[-1]} ([^ ]+).*/\2/p" <<<"$text" | head -n 1)
    case $taken in
      *'|'*) tr '|' '\n' <<<"$taken"; return ;;
      ''|TEXT*|NAME*)   # --help of the demo does not say what its options take
        values=$(listed_names "${words[-1]}")
        [ -z "$values" ] || printf '%s\n' "$values"
        [ -z "$values$taken" ] || return 0 ;;
      [A-Z]*) return ;;
    esac
  fi
  if [[ $current == -* ]]; then
    sed -nE 's/^  (-[a-z],)?(--[a-z][a-z0-9_-]*).*/\2/p' <<<"$text" | sort -u
  elif [ -z "$subcommand" ] && [ ${#subcommands[@]} -gt 0 ]; then
    printf '%s\n' "${subcommands[@]}"
  fi
}
