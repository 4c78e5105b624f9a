# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# The commands that `citylearn` (installed) and `./run` (in the repository) share. The script that reads this file has set
# COMMAND, by which it is called; PARTS, the folder of this file; and has defined program_path PATH, which prints where the
# program is whose path in a build folder is PATH, and prepare COMMAND..., which builds what these commands need.

RUNS=${CITYLEARN_RUNS:-runs}    # where results go by default
NAME=$(basename "$COMMAND")   # begins messages

# The program of each command, as its path in a build folder. demo.sh has the commands demo and again.
declare -A PROGRAMS=(
  [env]=env_service/env_service [encoder]=encoder_service/encoder_service [policy]=policy_service/policy_service
  [dashboard]=dashboard/dashboard [data]=tools/data/citylearn_data [doctor]=tools/doctor/citylearn_doctor
  [vpr]=tools/vpr/citylearn_vpr [export]=tools/export/citylearn_export [paper]=tools/paper/citylearn_paper
  [record]=tools/record/citylearn_record [replay]=tools/record/citylearn_replay [ros2]=tools/ros2/citylearn_ros2
  [teach]=tools/robot/citylearn_teach [simulated-robot]=tools/robot/citylearn_robot)
COMMANDS=(demo again dashboard env encoder policy data vpr export paper record replay robot teach simulated-robot ros2 doctor
  help)

say() { printf '%s\n' "$*" >&2; }
fail() { say "$NAME: $*"; exit 1; }

usage() {
  cat <<TEXT
$COMMAND COMMAND [ARGS]    "$COMMAND COMMAND --help" explains its ARGS.

Start here
  demo        trains an agent on one recording and evaluates it on all of them
  again RUN   repeats a demo: "$COMMAND again runs/20260101-120000 --seed 2"
  dashboard   serves the page: all recorded runs, and what runs now
  robot       teaches a simulated robot a route, and lets it repeat it

Services, each a program of its own
  env         serves a recorded traversal as an environment
  encoder     turns images into features
  policy      trains and evaluates agents

Data and results
  data        lists the supported datasets; checks a folder
  vpr         measures how well encoders recognise places
  export      writes an agent as an ONNX file
  paper       repeats the paper's experiments on your data
  record      records a run's messages; "replay" plays them again, or a bag to
              an agent
  teach       records a route from a robot's camera; "simulated-robot" is one
  ros2        publishes a run to ROS 2, or writes files that its tools open
  doctor      shows reachable services and diagnoses network problems
TEXT
}

program() { program_path "${PROGRAMS[$1]}"; }

# Sets `where` to the options by which a tool finds the newest demo that runs here; to none where there is no demo, or where
# the tool's options $@ or the environment say where to look.
where=()
find_demo() {
  local word file newest='' domain middleware session
  [ -z "${CITYLEARN_DOMAIN:-}" ] || return 0
  for word; do [[ $word != --domain* && $word != --help* && $word != -h ]] || return 0; done
  for file in "$RUNS"/.demo-*; do
    kill -0 "${file##*-}" 2>/dev/null || { rm -f "$file"; continue; }   # its demo was killed
    [ -n "$newest" ] && [ "$newest" -nt "$file" ] || newest=$file
  done
  [ -n "$newest" ] || return 0
  read -r domain middleware session <"$newest"
  where=(--domain "$domain" --middleware "$middleware" --session "$session")
  say "$NAME: looks at the demo that runs here: ${where[*]} (--domain 0 looks elsewhere)"
}

# Adds to `where` an option of the command's own, $1, with the value $2, unless the words $3... have it or ask for help.
add_default() {
  local word
  for word in "${@:3}"; do [[ $word != "$1" && $word != "$1="* && $word != --help* && $word != -h ]] || return 0; done
  mkdir -p "$RUNS"
  where+=("$1" "$2")
}

# Runs the command $1 with the arguments $2...
main() {
  local command=${1:-help}
  [ $# -eq 0 ] || shift
  case $command in
    demo|again)
      # shellcheck source=demo.sh
      . "$PARTS/demo.sh"
      "$command" "$@"
      return ;;
    robot)
      # shellcheck source=demo.sh
      . "$PARTS/demo.sh"
      # shellcheck source=robot.sh
      . "$PARTS/robot.sh"
      robot "$@"
      return ;;
    help|-h|--help) usage; return ;;
    --version) command='env'; set -- --version ;;
    *) [ -n "${PROGRAMS[$command]:-}" ] || fail "unknown command '$command'; there are: ${COMMANDS[*]}" ;;
  esac
  prepare "$command"
  case $command in
    doctor|record|ros2) [[ " $* " == *' --open'* ]] || find_demo "$@" ;;&
    record) add_default --output "$RUNS/$(date +%Y%m%d-%H%M%S).mcap" "$@" ;;
    dashboard)
      # Without CITYLEARN_RUNS the program's own default is the same file.
      [[ -z ${CITYLEARN_RUNS:-} || " $* " == *" --open"* ]] || add_default --store "$RUNS/dashboard.sqlite" "$@" ;;
  esac
  local path; path=$(program "$command")
  [ -x "$path" ] || fail "$command: its program '$path' is missing; build and install it"
  exec "$path" "${where[@]}" "$@"
}
