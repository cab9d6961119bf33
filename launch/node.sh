#!/usr/bin/env bash
# How the launch files of this folder start a node (their launch-prefix): node.sh DEPLOY PROGRAM ARGUMENTS...
#
# - DEPLOY false: what the node prints is shown in a terminal window of its own, where xterm and a display are there.
#   It is also in NAME-window.log beside the other ROS logs. Closing the window does not end the node.
# - The node takes the place of this script: the process that roslaunch names, watches and ends is the node.
# - A node that finds a mistake in the configuration, or itself running already, names it in one line. No restart can
#   mend that, though roslaunch would try for ever (respawn="true"): so the node ends the launch that the variable
#   names, as on Ctrl-C. Any other end is a crash, and roslaunch starts the node again.
deploy=$1
shift
export PYTHONUNBUFFERED=1 SKIROS2_LAUNCHED_BY=$PPID

case ${deploy,,} in
  true | 1) window= ;;
  *) window=$(command -v xterm) ;;
esac
if [ -n "$window" ] && [ -n "$DISPLAY" ]; then
  name=$(printf '%s\n' "$@" | sed -n 's/^__name:=//p')
  logs=${ROS_LOG_DIR:-${ROS_HOME:-$HOME/.ros}/log}
  output=$logs/$name-window.log
  mkdir -p "$logs" && : >"$output" || exit
  "$window" -T "$name" -e tail -n +1 -f --pid=$$ "$output" &
  exec "$@" >>"$output" 2>&1
fi
exec "$@"
