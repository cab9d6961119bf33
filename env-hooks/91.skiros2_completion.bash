# Completion of `rosrun skiros2_PACKAGE COMMAND ...`: commands, options, and what the running system has. The commands
# know it themselves (skiros2_common/command_line/completion.py). Silent when no ROS master runs.

# The function that completed rosrun before; it still does for other packages.
_skiros2_other=$({ complete -p rosrun 2>/dev/null || true; } | sed -n 's/.*-F \([^ ]*\).*/\1/p')
[ "$_skiros2_other" != _skiros2_rosrun ] || _skiros2_other=${_skiros2_before-}
_skiros2_before=$_skiros2_other

_skiros2_in_prefixes() { # the files of a pattern below lib/ of the sourced workspaces
  local IFS=: prefix
  for prefix in $CMAKE_PREFIX_PATH; do
    compgen -G "$prefix/lib/$1"
  done
}

_skiros2_rosrun() {
  local package=${COMP_WORDS[1]-} command=${COMP_WORDS[2]-} program
  COMPREPLY=()
  if [ "$COMP_CWORD" -lt 2 ] || [[ $package != skiros2_* ]]; then
    if [ -n "$_skiros2_other" ]; then
      "$_skiros2_other" "$@"
    elif [ "$COMP_CWORD" = 1 ]; then
      mapfile -t COMPREPLY < <(_skiros2_in_prefixes "$package*" | sed -n 's|.*/\(skiros2_[^./]*\)$|\1|p' | sort -u)
    fi
  elif [ "$COMP_CWORD" = 2 ]; then
    mapfile -t COMPREPLY < <(_skiros2_in_prefixes "$package/$command*" | sed 's|.*/||' | grep -v '_node$' | sort -u)
  else
    program=$(_skiros2_in_prefixes "$package/$command" | head -n 1)
    [ -x "$program" ] || return 0
    mapfile -t COMPREPLY < <(_SKIROS2_COMPLETE=bash "$program" 3 "${COMP_LINE:0:COMP_POINT}" 2>/dev/null </dev/null)
    case "${COMPREPLY[0]}" in *[=/]) compopt -o nospace 2>/dev/null ;; esac
  fi
}
complete -F _skiros2_rosrun rosrun
