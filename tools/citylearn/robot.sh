# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# The command `robot`: teach and repeat with simulated robots. commands.sh reads this file; demo.sh starts and stops programs.

robot_usage() {
  cat <<TEXT
$COMMAND robot [OPTIONS]    teaches a simulated robot a route and lets it repeat it

A robot is driven through the drawn city in summer while its camera is recorded.
An agent trains on that recording. Then robots drive by themselves, each in
another season or weather: the agent sees what their cameras see, and its actions
go to their wheels, which slip. All of it passes as messages of ROS 2.

  --looks A,B          where they drive (default fall,rain); "$COMMAND simulated-robot
                       --help" shows all
  --slip S             standard deviation of the way driven, as a share of it
                       (default 0.2)
  --places N           length of the route, about 4 m a place (default 48)
  --tasks N            goals that each robot is sent to (default 10)
  --speed V            of the robots, m/s (default 10)
  --output DIR         route/ (the recording), train/, repeat/ and logs/ (default
                       $RUNS/TIME)
  --middleware NAME    of the services: cyclonedds (default), fastdds; the robots
                       use the other one
  --no-dashboard       starts no dashboard
  --no-wait            ends when the results are printed
TEXT
}

declare -gA running   # process ids by name, as demo.sh has them

# Waits until the program called $1 has ended, well.
succeed() {
  finish "$1" || {
    local status=$?
    stop
    [ ! -e "$output/logs/$1.log" ] || tail -n 1 "$output/logs/$1.log" >&2
    fail "$1 failed (status $status); logs are in $output/logs"
  }
}

robot() {
  local looks=fall,rain slip=0.2 places=48 tasks=10 speed=10 output='' middleware=${CITYLEARN_MIDDLEWARE:-cyclonedds}
  local dashboard=yes wait=yes
  while [ $# -gt 0 ]; do
    case $1 in
      --looks|--slip|--places|--tasks|--speed|--output|--middleware)
        [ $# -ge 2 ] || fail "$1 needs a value"
        declare "${1#--}=$2"; shift 2 ;;
      --looks=*|--slip=*|--places=*|--tasks=*|--speed=*|--output=*|--middleware=*)
        local name=${1%%=*}; declare "${name#--}=${1#*=}"; shift ;;
      --no-dashboard) dashboard=no; shift ;;
      --no-wait) wait=no; shift ;;
      -h|--help) robot_usage; exit 0 ;;
      *) fail "robot: unknown option '$1'; $COMMAND robot --help lists them" ;;
    esac
  done
  [[ $places =~ ^[1-9][0-9]{0,4}$ && $places -ge 8 ]] || fail "--places: '$places' is not a number from 8 to 99999"
  [[ $tasks =~ ^[1-9][0-9]{0,4}$ ]] || fail "--tasks: '$tasks' is not a number from 1 to 99999"
  [[ $middleware =~ ^(cyclonedds|fastdds)$ ]] || fail "--middleware: '$middleware' is neither cyclonedds nor fastdds"
  local ros=fastdds
  [ "$middleware" != fastdds ] || ros=cyclonedds
  local services=(env encoder policy teach simulated-robot)
  [ $dashboard = no ] || services+=(dashboard)
  say "$NAME: teaches a simulated robot a route, trains an agent and lets it drive, in 1 to 3 minutes with the default options"
  prepare "${services[@]}"
  local look
  while IFS= read -r look; do
    "$(program simulated-robot)" --look "$look" --slip "$slip" --help >/dev/null || exit 1
  done < <(tr ',' '\n' <<<"$looks")

  "$(program env)" --speed "$speed" --help >/dev/null || exit 1

  local domain wire store recorders
  open_run
  local nodes=(--ros-domain "${ROS_DOMAIN_ID:-$((1 + (domain + 100) % 200))}" --ros-interface lo --ros-middleware "$ros")

  say "$NAME: teaches: a robot is driven along $((places * 4)) m in summer, and what its camera sees becomes $output/route"
  start teach "$(program teach)" --output "$output/route" --traversal summer --spacing 4 \
    --camera /summer/camera/image_raw/compressed --position /summer/pose --position-type pose "${nodes[@]}"
  until grep -qs 'listens to' "$output/logs/teach.log"; do
    kill -0 "${running[teach]}" 2>/dev/null || succeed teach
    sleep 0.05
  done
  start robot-summer "$(program simulated-robot)" --look summer --metres $((places * 4)) --drive 10 "${nodes[@]}" \
    --camera /summer/camera/image_raw/compressed --pose /summer/pose --odometry /summer/odom --cmd-vel /summer/cmd_vel
  succeed robot-summer
  end teach

  say "$NAME: trains on the recording"
  start env-summer "$(program env)" "${wire[@]}" "${recorders[@]}" --data "$output/route" --traversal summer --agents 16
  start encoder "$(program encoder)" "${wire[@]}" --reference summer
  "$(program policy)" "${wire[@]}" --mode train --train summer --evaluate summer --tasks 200 --wait 60 --id trainer \
    --place_filter-slip 0.2 --output "$output/train" &
  running[trainer]=$!
  succeed trainer

  say "$NAME: repeats: robots drive to $tasks goals each, in $looks"
  local evaluate=''
  while IFS= read -r look; do
    evaluate+=${evaluate:+,}robot-$look
    start "robot-$look" "$(program simulated-robot)" --look "$look" --metres $((places * 4)) --slip "$slip" "${nodes[@]}" \
      --camera "/$look/camera/image_raw/compressed" --pose "/$look/pose" --odometry "/$look/odom" --cmd-vel "/$look/cmd_vel"
    start "env-robot-$look" "$(program env)" "${wire[@]}" "${recorders[@]}" --dataset live --data "$output/route" --traversal summer \
      --as "robot-$look" --camera "/$look/camera/image_raw/compressed" --position "/$look/pose" --position-type pose \
      --cmd-vel "/$look/cmd_vel" --command "/$look/command" --speed "$speed" --settle 0.05 "${nodes[@]}"
  done < <(tr ',' '\n' <<<"$looks")
  "$(program policy)" "${wire[@]}" --mode evaluate --checkpoint "$output/train/checkpoints/best.clk" --evaluate "$evaluate" \
    --tasks "$tasks" --max-steps $((2 * places)) --wait 60 --output "$output/repeat" &
  running[policy_service]=$!
  succeed policy_service
  [ $wait = no ] || [ ! -t 0 ] || [ -z "${running[dashboard]:-}" ] || {
    say "The page stays open at $(sed -n '$s/^dashboard: //p' "$output/logs/dashboard.address") Press any key to end."
    read -rsn 1 || true
  }
}
