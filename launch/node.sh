#!/usr/bin/env bash
# How the launch files of this folder start a node (their launch-prefix): node.sh DEPLOY PROGRAM ARGUMENTS...
#
# - DEPLOY false: what the node prints is shown in a terminal window of its own, where xterm and a display are there.
#   It is also in NAME-window.log beside the other ROS logs. Closing the window does not end the node.
# - A node that ends with status 78 has found a mistake in the configuration and has named it in one line. No restart
#   can mend that, though roslaunch would try for ever (respawn="true"): so the whole launch ends, as on Ctrl-C.
#   Any other end is a crash, and roslaunch starts the node anew.
deploy=$1
shift
export PYTHONUNBUFFERED=1
trap : INT TERM # roslaunch signals the whole group: the node ends in its own time, then this script

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
  "$@" >>"$output" 2>&1
  status=$?
  [ $status != 78 ] || tail -n 1 "$output" >&2
else
  "$@"
  status=$?
fi

if [ $status = 78 ]; then
  kill -INT "$PPID"
  sleep 60 # until roslaunch ends this script too: were it gone earlier, roslaunch would start the node anew
fi
exit $status
