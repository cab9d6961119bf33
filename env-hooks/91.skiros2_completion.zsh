# Completion of `rosrun skiros2_PACKAGE COMMAND ...` in zsh; see 91.skiros2_completion.bash. Source after compinit.

_skiros2_rosrun() {
  local package=$words[2] command=$words[3] prefix
  local -a prefixes found
  prefixes=(${(s.:.)CMAKE_PREFIX_PATH})
  if (( CURRENT == 2 )); then
    found=(${^prefixes}/lib/skiros2_*(N:t))
  elif (( CURRENT == 3 )); then
    found=(${^prefixes}/lib/$package/*~*_node(N:t))
  else
    for prefix in $prefixes; do
      [[ -x $prefix/lib/$package/$command ]] || continue
      found=("${(@f)$(_SKIROS2_COMPLETE=zsh $prefix/lib/$package/$command "${(@Q)words[4,CURRENT]}" 2>/dev/null </dev/null)}")
      break
    done
  fi
  local -a open=(${(M)found:#*[=/]}) closed=(${found:#*[=/]})
  if (( $#open )); then compadd -S '' -- $open; fi
  if (( $#closed )); then compadd -- $closed; fi
}
if (( $+functions[compdef] )); then compdef _skiros2_rosrun rosrun; fi
