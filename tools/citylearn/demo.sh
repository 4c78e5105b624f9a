# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# The command `demo`: starts the services of a run here, shows the results and stops them. commands.sh reads this file.

demo_usage() {
  cat <<TEXT
$COMMAND demo [OPTIONS]    trains on one traversal and evaluates on all

A first run needs none of them, or these
  --data DIR           recordings: each traversal is a folder of images or a
                       video, DIR/NAME/ or DIR/NAME.mp4, or features,
                       DIR/NAME.csv, one frame a row (default: a drawn city)
  --train A[,B]        traversal to train on (default summer, or else the first
                       by name); A,B trains on both, as experiences of the
                       route of A; A+B with --rule street on both drives as one
                       map, where they meet
  --evaluate A,B       traversals to evaluate on (default all; of A+B itself)
  --frames FIRST:END   part of the route to use, 0-based, half open (default
                       0:128, or all of a shorter route)
  --agent NAME         place_filter (default), features, raw_images,
                       baseline
  --output DIR         summary.json, metrics.csv, manifest.json, checkpoints/
                       (default $RUNS/TIME, from the folder that you are in)

What it runs on
  --dataset NAME       format of DIR (default: what "$COMMAND data check"
                       recognises); "$COMMAND data list" shows all
  --rule RULE          street: agents turn and go on a map of streets, as the
                       drawn city has one and DIR may; line: along the frames
  --align-by HOW       how to find the same places in other recordings: index,
                       matches, distance, gps, or sight, by what they show
                       (default: as the dataset suggests; sight, where it
                       suggests index and recordings differ in length);
                       --align-within METRES is for distance and gps
  --encoder NAME       how images become features (default hog_vlad);
                       "$COMMAND encoder --list" shows all. FILE.py is
                       a function of yours. Options of the encoder may follow:
                       --dimension --centring --whitening --model --layer
                       --preset --store
  --plugin A.so[,B.so] datasets, encoders, networks and learners of your own
  --DATASET-X, --ENCODER-X   parameters that "$COMMAND env --list" and
                       "$COMMAND encoder --list" show, as --kitti-camera

What it trains
  --seed N             seed of all randomness (default 1)
  --seeds 1..5         one run for each seed, then medians and spreads
  --slip P             actions slip with probability P, in training too, which
                       no policy is told (default 0.1: learning pays there; 0:
                       a perfect world, as the paper's). --dropped-frames,
                       --kidnappings: "$COMMAND env --help" has these too
  --time-limit S       ends training after S seconds
  --resume             continues with the newest checkpoint in --output
  Any other option is passed unchanged to the policy_service
  ("$COMMAND policy --help").

Where
  --middleware NAME    cyclonedds (default), fastdds
  --port N             port of the page (default a free one)
  --no-dashboard       shows and records the run on no page. Otherwise an open
                       "$COMMAND dashboard" does so, or one of the demo's own
  --no-wait            ends when the results are printed. Otherwise, on a
                       terminal, the page stays open until a key is pressed
TEXT
}

declare -gA running=()   # process ids of the demo's services, by name

# Starts a service of the demo: NAME COMMAND... Its log is logs/NAME.log in the output folder.
start() {
  "${@:2}" 2>"$output/logs/$1.log" &
  running[$1]=$!
}

# Ends the services named, or kills them where they have not ended within 10 s.
end() {
  local name try pids=()
  for name; do
    [ -z "${running[$name]:-}" ] || pids+=("${running[$name]}")
    unset "running[$name]"
  done
  [ ${#pids[@]} -gt 0 ] || return 0
  kill "${pids[@]}" || true
  for ((try = 0; try < 200; ++try)); do
    kill -0 "${pids[@]}" || break
    sleep 0.05
  done
  kill -KILL "${pids[@]}" || true
  wait "${pids[@]}" || true
} 2>/dev/null

# Ends all services, the dashboard last: env_services hand it their last episodes.
stop() {
  trap '' INT TERM
  rm -f "$RUNS/.demo-$$"
  local name others=()
  for name in "${!running[@]}"; do [ "$name" = dashboard ] || others+=("$name"); done
  end "${others[@]}"
  end dashboard
}

# Prints the address, domain and id of the `dashboard` that is open here, hears demos and records into the store $1; false
# where there is none.
open_dashboard() {
  local address domain id process
  { read -r address domain id process <"$1.lock"; } 2>/dev/null &&
    grep -qsx dashboard "/proc/$process/comm" && printf '%s %s %s\n' "$address" "$domain" "$id"
}

# Starts the dashboard with options $2... on the store $1; false when it ends at once.
start_dashboard() {
  local store=$1; shift
  start dashboard "$(program dashboard)" --store "$store" "$@" >"$output/logs/dashboard.address"
  until [ -s "$output/logs/dashboard.address" ]; do
    kill -0 "${running[dashboard]}" 2>/dev/null || { unset 'running[dashboard]'; return 1; }
    sleep 0.05
  done
}

# Opens a run of its own, by default below RUNS: makes its folder `output`, sets `domain` and `wire`, the options by which its
# services meet over `middleware`, and ends them when this script ends. Several runs on one machine don't meet. Where `dashboard`
# is yes, sets `store`, where the run is recorded, and `recorders`, options of its env_services.
open_run() {
  local page='' shared='' recorder='' session problem
  recorders=() store=''
  [ $dashboard = no ] || store=$RUNS/dashboard.sqlite
  # An open dashboard hears one domain; it shows and records this run too, unless another domain or port is asked for.
  [ -z "$store" ] || [ "${port:-0}" != 0 ] || read -r page shared recorder < <(open_dashboard "$store") || true
  [ "${CITYLEARN_DOMAIN:-$shared}" = "$shared" ] || page='' shared=''
  output=${output:-$RUNS/$(date +%Y%m%d-%H%M%S)}
  problem=$(mkdir -p "$output/logs" 2>&1) || fail "--output: $problem"
  session=$(basename "$(realpath -m "$output")" | tr -c 'A-Za-z0-9._\n-' _ | cut -c 1-64)
  domain=${CITYLEARN_DOMAIN:-${shared:-$((1 + $$ % 100))}}
  wire=(--session "$session" --domain "$domain" --middleware "$middleware")
  mkdir -p "$RUNS"
  printf '%s %s %s\n' "$domain" "$middleware" "$session" >"$RUNS/.demo-$$"
  trap stop EXIT
  trap 'exit 130' INT
  trap 'exit 143' TERM
  problem=''
  if [ -n "$page" ]; then
    printf 'dashboard: %s\n' "$page"
    recorders=(--recorders "$recorder")
  elif [ -n "$store" ]; then
    # All demos share a store, so that their runs can be compared; while another one has it, this one has its own.
    start_dashboard "$store" "${wire[@]}" --port "${port:-0}" ||
      { store=$output/dashboard.sqlite
        problem="another dashboard records into $RUNS/dashboard.sqlite: this run is kept in $store"
        start_dashboard "$store" "${wire[@]}" --port "${port:-0}"; } ||
      { tail -n 1 "$output/logs/dashboard.log" >&2; fail "the dashboard did not start; --no-dashboard goes without it"; }
    cat "$output/logs/dashboard.address"
    recorders=(--recorders dashboard)
  fi
  say "$NAME: domain $domain, session $session; $COMMAND doctor and $COMMAND record find it"
  [ -z "$problem" ] || say "$NAME: $problem"
}

# Waits until the program called $1 has ended, and returns its status. Another one that ends before has said why in its log, and
# ends all, but for the dashboard. (bash's `wait -n` misses a service that is killed before it is called.)
finish() {
  local name status never
  exec {never}<> <(:)   # to wait on, without starting a `sleep` each time
  while true; do
    for name in "${!running[@]}"; do
      ! kill -0 "${running[$name]}" 2>/dev/null || continue
      status=0
      wait "${running[$name]}" || status=$?
      unset "running[$name]"
      case $name in
        "$1") return $status ;;
        dashboard) say "$NAME: the dashboard ended early, so this run is not recorded to its end; its log is $output/logs/$name.log" ;;
        *)
          stop
          tail -n 1 "$output/logs/$name.log" >&2 || true
          fail "$name ended early (status $status); its log is $output/logs/$name.log" ;;
      esac
    done
    read -rt 0.1 -u "$never" || true
  done
}

# Repeats the demo whose folder is $1 in a new folder; $2... are added to its options.
again() {
  local folder=${1:-}
  if [ "$folder" = -h ] || [ "$folder" = --help ]; then
    say "$COMMAND again RUN [OPTIONS]    repeats the demo whose folder is RUN; OPTIONS, those of
demo, are added to its own. Its results go to a new folder."
    return
  fi
  [ -n "$folder" ] || fail "again: name the folder of a demo's run, as $COMMAND again runs/20260101-120000"
  shift
  local before=() words=$folder/demo.words
  [ -e "$words" ] || words=$folder/../demo.words   # of one of its seeds
  [ -e "$words" ] || fail "again: '$folder': is no folder of a demo's run (there is no demo.words)"
  mapfile -d '' -t before <"$words"
  set -- "${before[@]}" --output= "$@"
  say "$COMMAND demo $(printf '%q ' "$@")"
  demo "$@"
}

absolute_list() { tr , '\n' <<<"$1" | xargs -d '\n' realpath -ms | paste -sd ,; }

# Prints the demo's words $@ for the file demo.words, each with a null byte behind it: `again` repeats them, in any folder.
repeatable() {
  local word option=''
  [ $# -gt 0 ] || set -- --output=   # which is the default
  for word; do
    case $option in
      --data|--model|--initial) word=$(realpath -ms "$word") ;;
      --encoder) [[ $word != *.py ]] || word=$(realpath -ms "$word") ;;
      --plugin) word=$(absolute_list "$word") ;;
    esac
    option=$word
    case $word in
      --data=*|--model=*|--initial=*|--encoder=*.py) word=${word%%=*}=$(realpath -ms "${word#*=}") ;;
      --plugin=*) word=--plugin=$(absolute_list "${word#*=}") ;;
    esac
    printf '%s\0' "$word"
  done
}

# Prints a command that one may try next, $1, and what it does.
next() { printf '  %s\n      %s\n' "$COMMAND $1" "$2" >&2; }

# Prints the words $@ of env_services and encoder_services as the policy_service's --source, each with a null byte behind it.
as_source() {
  local name value
  while [ $# -gt 0 ]; do
    case $1 in
      --*=*) name=${1%%=*} value=${1#*=}; shift ;;
      *) name=$1 value=$2; shift 2 ;;
    esac
    case $name in
      --plugin|--store) continue ;;
      --data|--model) value=$(realpath -ms "$value") ;;
      --encoder) [[ $value != *.py ]] || value=$(realpath -ms "$value") ;;
    esac
    printf '%s\0' --source "${name#--}=$value"
  done
}

# Says what one may do next. On a terminal the page stays up until a key is pressed, unless $1 is no.
after_demo() {
  local run other=features; run=$(printf %q "$output")
  [[ " ${pass[*]} " != *[\ =]features\ * ]] || other=place_filter
  say "Next:"
  case $store in
    '') ;;
    "$RUNS/dashboard.sqlite") next dashboard "shows this run and all earlier ones again" ;;
    *) next "dashboard --store $(printf %q "$store")" "shows this run again" ;;
  esac
  next "again $run --agent $other" "trains another agent on the same recordings"
  [ "${streets:-}" = yes ] || [ ! -e "$output/checkpoints/best.clk" ] ||   # place_filter is not exported there
    next "export --checkpoint $run/checkpoints/best.clk --output agent.onnx" "writes the agent as an ONNX file"
  [ -n "$data" ] || next "demo --data DIR --train A --evaluate B" "does the same with your own recordings"
  [ "$1" = yes ] && [ -t 0 ] && [ -n "${running[dashboard]:-}" ] || return 0
  say "The page stays open at $(sed -n '$s/^dashboard: //p' "$output/logs/dashboard.address") Press any key to end."
  read -rsn 1 || true
}

# Sets `value` to that of the option $1, in the same word or the next, and `taken` to the number of both words.
take_value() {
  taken=1 value=${1#*=}
  [[ $1 != *=* ]] || return 0
  [ $# -ge 2 ] && [[ $2 != --* ]] || fail "$1 needs a value"
  taken=2 value=$2
}

demo() {
  local data='' dataset='' train='' evaluate='' frames='' middleware=${CITYLEARN_MIDDLEWARE:-cyclonedds} output='' pass=() encoding=()
  local plugins='' aligning=() notes=() slip='' world=() rule=()
  local -x LC_ALL=C    # names of recordings are bytes: in UTF-8, `read` joins one that is not with the next
  local -A called=()   # what env_services call the traversals
  local dashboard=yes port=0 wait=yes asked=("$@")
  local name value taken
  while [ $# -gt 0 ]; do
    taken=1
    case $1 in
      --no-dashboard) dashboard=no ;;
      --no-wait) wait=no ;;
      -h|--help) demo_usage; exit 0 ;;
      *)
        name=${1%%=*}
        case $name in
          --data|--dataset|--train|--evaluate|--frames|--middleware|--output|--port|--slip)
            take_value "$@"; declare "${name#--}=$value" ;;
          --encoder|--dimension|--centring|--whitening|--model|--layer|--preset|--store)
            take_value "$@"; encoding+=("$name=$value") ;;
          --dropped-frames|--kidnappings|--goal-place|--goals) take_value "$@"; world+=("$name=$value") ;;
          --rule) take_value "$@"; rule=("$name=$value") ;;
          --align-by|--align-within) take_value "$@"; aligning+=("$name=$value") ;;
          --plugin) take_value "$@"; plugins+=$value, ;;
          --domain|--session) fail "$name: a demo has its own; CITYLEARN_DOMAIN=N sets the domain" ;;
          *) pass+=("$1") ;;
        esac ;;
    esac
    shift $taken
  done
  [ -z "$data" ] || [ -d "$data" ] || fail "--data: '$data' is not a folder"
  local count=${frames:-128} part=()
  case $frames in
    *:*) [[ $frames =~ ^[0-9]+:[0-9]+$ && ${frames%:*} -lt ${frames#*:} ]] || fail "--frames: '$frames' is not FIRST:END, as 0:128"
         count=$((${frames#*:} - ${frames%:*})); part=(--frames "$frames") ;;
    *) [[ $count =~ ^[0-9]+$ ]] || fail "--frames: '$frames' is not FIRST:END, as 0:128" ;;
  esac
  say "$NAME: trains an agent ${data:+on recordings in $data }and tests it, in 1 to 3 minutes with the default options"
  local services=(env encoder policy)
  [ $dashboard = no ] || services+=(dashboard)
  prepare "${services[@]}"
  local env encoder policy; env=$(program env) encoder=$(program encoder) policy=$(program policy)
  local source=(--dataset synthetic)
  [ -z "$data" ] || source=(--data "$data" ${dataset:+--dataset "$dataset"})
  # Each plug-in is for the services that can load it; the policy_service says what is wrong with one that none can.
  local file used plug_env=() plug_encoder=()
  while IFS= read -r -d , file; do
    used=no
    ! "$env" --plugin "$file" --list >/dev/null 2>&1 || { plug_env+=(--plugin "$file"); used=yes; }
    ! "$encoder" --plugin "$file" --list >/dev/null 2>&1 || { plug_encoder+=(--plugin "$file"); used=yes; }
    [ $used = yes ] && ! "$policy" --plugin "$file" --list >/dev/null 2>&1 || pass+=(--plugin "$file")
  done <<<"$plugins"
  source+=("${plug_env[@]}" "${rule[@]}") encoding+=("${plug_encoder[@]}")
  # Parameters of datasets and encoders are for the services that list them, all else is for the policy_service.
  if [ ${#pass[@]} -gt 0 ]; then
    local of_datasets of_encoders line taken rest=()
    of_datasets=$("$env" "${plug_env[@]}" --list) of_encoders=$("$encoder" "${plug_encoder[@]}" --list)
    set -- "${pass[@]}"
    while [ $# -gt 0 ]; do
      line=$'\n'"      ${1%%=*} " taken=1
      [[ $1 == *=* || $# -lt 2 ]] || taken=2
      if [[ $of_datasets == *"$line"* ]]; then
        source+=("${@:1:taken}")
      elif [[ $of_encoders == *"$line"* ]]; then
        encoding+=("${@:1:taken}")
      else
        taken=1 rest+=("$1")
      fi
      shift $taken
    done
    pass=("${rest[@]}")
  fi
  local known; known=$("$env" "${source[@]}" --list-traversals) || exit 1
  if [ -z "$train" ]; then
    train=$(grep -x summer <<<"$known" || head -n 1 <<<"$known")
    [ "$train" = summer ] || notes+=("trains on '$train', as no traversal is called summer; --train takes another")
  fi
  local route=${train%%,*}   # the others are aligned to it, and the encoder learns from it
  [ -n "$evaluate" ] || [[ $route != *+* ]] || grep -qxF -- "$route" <<<"$known" || evaluate=$train   # drives that are joined
  # As many agents as the chosen agent trains best with; it says so itself, and complains of options it does not know.
  local agents; agents=$("$policy" "${pass[@]}" ${output:+--output "$output"} --show-config) || exit 1
  agents=$(awk '$1 == "--trainer-agents" { print $2 }' <<<"$agents")
  agents=${agents:-16}   # with --mode evaluate any number will do
  # Sets `dataset`, `kind` (whether it has images, yes or no), `pairs` (how they are found) and `length` of the traversal $1.
  local -A looked=()   # what was shown before
  look_at() {
    local same=(); [ "$1" = "$route" ] || [ ${#aligning[@]} -eq 0 ] || same=(--align-to "$route" "${aligning[@]}")
    local words=(--traversal "$1" "${part[@]}" "${same[@]}"); local shown=${looked[${words[*]}]:-}
    [ -n "$shown" ] || shown=$("$env" "${source[@]}" "${words[@]}" "${world[@]}" --show) || return 1
    looked[${words[*]}]=$shown pairs='' streets=''
    local line
    while IFS= read -r line; do
      case $line in
        'matched by '*) pairs=${line#matched by } ;;
        'dataset '*) dataset=${line#* } ;;
        'streets '*) streets=${line#* } ;;
        'images '*) kind=${line#* } ;;
        'frames '*) length=${line#* } ;;
        'traversal '*) called[$1]=${line#* } ;;
      esac
    done <<<"$shown"
  }
  # Matches recordings of unequal lengths among $1 (A,B; empty: all) by what they show, if they show the same places: frames of
  # one index hardly do.
  match_by_sight() {
    local of_part=("${part[@]}") all=${1//,/$'\n'} same=() unequal='' first
    part=()
    look_at "$route" && first=$length || return 0
    while IFS= read -r name; do
      look_at "$name" 2>/dev/null && [ "$kind" = "$images" ] || continue
      same+=("$name")
      [ "$length" = "$first" ] || unequal="'$route' has $first frames and '$name' $length"
    done <<<"${all:-$known}"
    part=("${of_part[@]}")
    [ -n "$unequal" ] || return 0
    aligning=(--align-by sight)
    [ "$streets" = yes ] || [ ${#part[@]} -gt 0 ] || part=(--frames "0:$((first < count ? first : count))")
    for name in "${same[@]}"; do
      look_at "$name" && continue
      aligning=() part=("${of_part[@]}")
      notes+=("$unequal: frames of one index are taken for one place; --align-by and matches.csv tell otherwise")
      return 0
    done
    notes+=("$unequal: frames that look alike are taken for one place, as by --align-by sight")
  }
  [ -n "$slip" ] || { slip=0.1; notes+=("actions slip, one in ten, which no policy is told; --slip 0 is a world where none does"); }
  world+=(--slip "$slip")
  # Prints what env_services call the traversals $1, A,B,...
  names_of() {
    tr ',' '\n' <<<"$1" | while IFS= read -r name; do [ -z "$name" ] || printf '%s\n' "${called[$name]:-$name}"; done | paste -sd ,
  }
  local text words   # one start, which takes .15 s, shows all
  if [ -z "$evaluate" ] && [ ${#aligning[@]} -eq 0 ]; then
    while IFS= read -r text; do
      if [[ $text == 'recording '* ]]; then
        words=(--traversal "${text#* }" "${part[@]}")
      else
        looked[${words[*]}]+=$text$'\n'
      fi
    done < <("$env" "${source[@]}" "${part[@]}" "${world[@]}" --list-traversals --show 2>/dev/null)
  fi
  local kind length pairs streets; look_at "$route" || exit 1
  [ "$streets" != yes ] || [ -n "$frames" ] || { frames=0:$length count=$length; }   # they are walked as a whole
  local images=$kind whole=$length shortest=$length
  [ ${#aligning[@]} -gt 0 ] || [ "$pairs" != index ] || match_by_sight "${evaluate:+$train,$evaluate}"
  [ -n "$frames" ] || [ ${#aligning[@]} -eq 0 ] || part=(--frames "0:$((length < count ? length : count))")
  if [ -z "$frames" ] || [ -z "$evaluate" ]; then
    local all=${evaluate:+$train,$evaluate} given=$evaluate
    all=${all//,/$'\n'}
    while IFS= read -r name; do
      if [ -n "$given" ]; then
        look_at "$name" || exit 1
      else
        # Pictures and features in one folder do not mix: what is of the other kind is something else.
        look_at "$name" || { say "$NAME: '$name' is left out"; continue; }
        [ "$kind" = "$images" ] || continue
        evaluate+=${evaluate:+,}$name
      fi
      [ "$length" -ge "$shortest" ] || shortest=$length
    done <<<"${all:-$known}"
  fi
  if [ -z "$frames" ] && [ "$shortest" -lt "$count" ]; then
    count=$shortest
    notes+=("the shortest traversal has $count frames: --frames is 0:$count instead of 0:128")
  elif [ -z "$frames" ] && [ -n "$data" ] && [ "$whole" -gt "$count" ]; then
    notes+=("takes the first $count of the $whole frames of '$route'; --frames takes another part, or more")
  fi
  local aligned=$images   # frames of equal index in tables of features show the same place already
  [[ $dataset =~ ^(plain|synthetic)$ && ${#aligning[@]} -eq 0 && $route != *+* ]] || aligned=yes
  # No more pictures, and no more places to align, than the agents will see.
  [ "$aligned" = no ] || [ "$streets" = yes ] || [ ${#part[@]} -gt 0 ] || part=(--frames "0:$count")
  if [ "$images" = yes ]; then
    "$encoder" "${encoding[@]}" --list >/dev/null || exit 1
  fi
  [[ " ${pass[*]}" == *' --controls'* ]] || pass+=(--controls all)
  local domain wire store recorders traversal note
  open_run
  repeatable "${asked[@]}" >"$output/demo.words"
  for note in "${notes[@]}"; do say "$NAME: $note"; done
  while IFS= read -r traversal; do
    local align=() tested=256   # agents in evaluations, whose figures are the same for any number of them
    [ -n "${called[$traversal]:-}" ] || look_at "$traversal" || exit 1
    [ "$aligned" = no ] || [ "$traversal" = "$route" ] || align=(--align-to "$route" "${aligning[@]}")
    [ "$count" -le 100000 ] || tested=32   # more take much memory on a very long route
    start "env-$traversal" \
      "$env" "${wire[@]}" "${source[@]}" --traversal "$traversal" "${part[@]}" "${align[@]}" "${world[@]}" --agents "$agents" \
      --evaluation-agents "$tested" "${recorders[@]}"
  done < <(tr ',' '\n' <<<"$train,$evaluate" | awk 'NF && !seen[$0]++')
  # Checkpoints carry how the data were found and encoded.
  [ "$aligned" = no ] || aligning=(--align-to "$route" "${aligning[@]}")
  encoding=(--reference "${called[$route]}" "${encoding[@]}")
  [ "$images" = yes ] || encoding=()
  local found=()
  source+=(--dataset "$dataset" "${world[@]}")
  mapfile -d '' -t found < <(as_source "${source[@]}" "${part[@]}" "${aligning[@]}" "${encoding[@]}")
  [ "$images" = no ] || start encoder "$encoder" "${wire[@]}" "${encoding[@]}"
  "$policy" "${wire[@]}" --mode train --train "$(names_of "$train")" --evaluate "$(names_of "$evaluate")" --frames "0:$count" \
    --wait 60 "${found[@]}" --output "$output" "${pass[@]}" &
  running[policy_service]=$!

  local status=0
  finish policy_service || status=$?
  [ $status -ne 0 ] || after_demo "$wait"
  return $status
}
