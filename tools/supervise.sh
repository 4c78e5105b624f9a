# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash disable=SC2034
# Keeps services running: what dies is started again, after 1 s, 2 s, 4 s ... at most 30 s. Sourced by ./run and by its
# test; docs/decisions/0014-faults.md says what is started again and what is not.
#
#   keep NAME LOG AGAIN COMMAND ...   starts a service; its standard error goes to LOG ('': as it is). AGAIN: options for
#                                     later starts alone ('': none)
#   adopt NAME PID LOG COMMAND ...    takes care of one that runs already; COMMAND starts it again
#   keep_until_one_ends               for good; `ended` then names it. Returns its exit status
#   let_go [NAME ...]                 ends these services, or all

KEEP_FIRST=${KEEP_FIRST:-1000} KEEP_MOST=30000   # milliseconds of pause
KEEP_AT_ONCE=${KEEP_AT_ONCE:-1000}               # what lives shorter, milliseconds, has ended at once
KEEP_DEATHS=5 KEEP_WITHIN=60                     # so many in so many seconds: given up

declare -A kept_pid kept_command kept_again kept_log   # by name
declare -A kept_since kept_deaths kept_complained      # milliseconds; times of deaths, seconds; ended with an error before
declare -A kept_pause kept_due                         # milliseconds; when it starts again: then it has no process
ended=''
# Bash itself says "Killed" where it likes: standard error is kept for what is said here.
exec {keep_said}>&2
exec {keep_idle}<> <(:)   # nothing ever comes

# Sets `kept_now`, milliseconds. (A subshell that echoes it would give bash time to say "Killed" where it likes.)
keep_now() { kept_now=$((${EPOCHREALTIME/[.,]/} / 1000)); }

keep_start() {  # NAME OPTIONS
  local name=$1 command="exec ${kept_command[$1]} $2"
  keep_now
  kept_since[$name]=$kept_now
  if [ -n "${kept_log[$name]}" ]; then
    eval "$command" 2>>"${kept_log[$name]}" &
  else
    eval "$command" 2>&"$keep_said" &
  fi
  kept_pid[$name]=$!
}

keep_know() {  # NAME LOG AGAIN COMMAND ...
  local name=$1
  keep_now
  kept_log[$name]=$2 kept_again[$name]=$3 kept_since[$name]=$kept_now
  kept_deaths[$name]='' kept_complained[$name]='' kept_pause[$name]=$KEEP_FIRST
  shift 3
  kept_command[$name]=$(printf '%q ' "$@")
}

keep() {
  keep_know "$@"
  [ -z "$2" ] || : >"$2"
  keep_start "$1" ''
} 2>/dev/null

adopt() {
  local name=$1 pid=$2 log=$3; shift 3
  keep_know "$name" "$log" '' "$@"
  kept_pid[$name]=$pid
}

# It ended: true when it is to be started again, and then says so.
keep_died() {  # NAME STATUS
  keep_now
  local name=$1 status=$2 lived=$((kept_now - kept_since[$1])) how time deaths=''
  case $status in
    0 | 2 | 130 | 143) return 1 ;;   # done, a wrong option, asked to stop
    1)
      # A complaint. At once, or a second time, it would only be repeated.
      [ "$lived" -ge "$KEEP_AT_ONCE" ] && [ -z "${kept_complained[$name]}" ] || return 1
      kept_complained[$name]=yes
      how='ended with an error' ;;
    *)
      kept_complained[$name]=''
      how="ended with status $status"
      [ "$status" -le 128 ] || how="was killed by signal $((status - 128))" ;;
  esac
  for time in ${kept_deaths[$name]} $SECONDS; do
    [ $((SECONDS - time)) -gt $KEEP_WITHIN ] || deaths+=" $time"
  done
  kept_deaths[$name]=$deaths
  if [ "$(wc -w <<<"$deaths")" -ge $KEEP_DEATHS ]; then
    echo "run: $name $how, the ${KEEP_DEATHS}th time within $KEEP_WITHIN s: given up" >&"$keep_said"
    return 1
  fi
  [ "$lived" -lt $((KEEP_WITHIN * 1000)) ] || kept_pause[$name]=$KEEP_FIRST
  local pause=${kept_pause[$name]}
  printf 'run: %s %s; it starts again in %d.%03d s\n' "$name" "$how" $((pause / 1000)) $((pause % 1000)) >&"$keep_said"
  kept_due[$name]=$((kept_now + pause))
  kept_pause[$name]=$((pause * 2 < KEEP_MOST ? pause * 2 : KEEP_MOST))
}

keep_until_one_ends() {
  local name status
  while true; do
    for name in "${!kept_pid[@]}"; do
      ! kill -0 "${kept_pid[$name]}" || continue
      status=0
      wait "${kept_pid[$name]}" || status=$?
      unset "kept_pid[$name]"
      keep_died "$name" "$status" || { ended=$name; return "$status"; }
    done
    keep_now
    for name in "${!kept_due[@]}"; do
      [ "$kept_now" -ge "${kept_due[$name]}" ] || continue
      unset "kept_due[$name]"
      keep_start "$name" "${kept_again[$name]}"
    done
    read -rt 0.2 -u "$keep_idle" || true
  done
} 2>/dev/null

let_go() {
  local name pids=()
  [ $# -gt 0 ] || set -- "${!kept_command[@]}"
  for name in "$@"; do
    [ -z "${kept_pid[$name]:-}" ] || pids+=("${kept_pid[$name]}")
    unset "kept_pid[$name]" "kept_due[$name]"
  done
  [ ${#pids[@]} -gt 0 ] || return 0
  kill "${pids[@]}" || true
  for name in "${pids[@]}"; do wait "$name" || true; done
} 2>/dev/null
