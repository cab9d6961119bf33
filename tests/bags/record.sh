#!/usr/bin/env bash
# Records a run on a master of its own, compressed: record.sh BAG "ROSLAUNCH ARGUMENTS" COMMAND...
#
# The command is run once the skill manager is there, in a shell with the installed packages; .ci/in_ros starts this
# script with them. The recorder begins before the system.
set -euo pipefail
bag=$(realpath -m "$1")
read -ra launch <<<"$2"
shift 2
robot=${ROBOT:-mobile_manipulator}
home=$(mktemp -d)
export ROS_MASTER_URI=http://localhost:${PORT:-12399} ROS_HOSTNAME=localhost ROS_HOME=$home HOME=$home
export PYTHONPATH=$(dirname "$(realpath "$0")")/../libraries:${PYTHONPATH:-}
trap 'kill -INT $(jobs -p) 2>/dev/null; wait; grep -iE "error|warn|died" "$home/system.txt" | tail -n 5; rm -rf "$home"' EXIT
roscore -p "${PORT:-12399}" >"$home/master.txt" 2>&1 &
until rosparam list >/dev/null 2>&1; do sleep 0.1; done
rosrun skiros2_bags record -o "$bag" --force --robots "$robot" --compression bz2 --evidence \
  --without "${WITHOUT:-/rosout.*|/tf.*|/$robot/execute/feedback}" --also "${ALSO:-}" >"$home/recorder.txt" 2>&1 &
recorder=$!
until grep -q 'recording to' "$home/recorder.txt"; do sleep 0.1; done
roslaunch --skip-log-check --no-summary "${launch[@]}" >"$home/system.txt" 2>&1 &
until rosservice list 2>/dev/null | grep -q "/$robot/command"; do sleep 0.1; done
sleep 2 # discovery
"$@" || true
sleep 1
kill -INT $recorder
wait $recorder || true
cat "$home/recorder.txt"
