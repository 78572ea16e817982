# Completes rosrun ground identify, track, tune and workbench (argcomplete); all else as before.
_ground_programs="$CATKIN_ENV_HOOK_WORKSPACE/lib/ground"
if ! complete -p rosrun >/dev/null 2>&1 && [ -r /usr/share/bash-completion/completions/rosbash ]; then
  . /usr/share/bash-completion/completions/rosbash
fi
if [[ "$(complete -p rosrun 2>/dev/null)" =~ -F\ ([^ ]+) && "${BASH_REMATCH[1]}" != _ground_rosrun ]]; then
  _ground_former="${BASH_REMATCH[1]}"
fi

_ground_complete() {
  local IFS=$'\013'
  COMPREPLY=($(IFS="$IFS" COMP_LINE="$COMP_LINE" COMP_POINT="$COMP_POINT" COMP_TYPE="$COMP_TYPE" \
    _ARGCOMPLETE_COMP_WORDBREAKS="$COMP_WORDBREAKS" _ARGCOMPLETE=3 \
    "$_ground_programs/${COMP_WORDS[2]}" 8>&1 9>/dev/null 1>/dev/null 2>/dev/null))
  [[ ${#COMPREPLY[@]} -ne 1 || $COMPREPLY != *[=/:] ]] || compopt -o nospace
}

_ground_rosrun() {
  if [ "$COMP_CWORD" -gt 2 ] && [ "${COMP_WORDS[1]}" = ground ]; then
    case "${COMP_WORDS[2]}" in
      identify | track | tune | workbench) _ground_complete && return ;;
    esac
  fi
  if [ -n "$_ground_former" ]; then
    "$_ground_former" "$@"
  fi
}
complete -o bashdefault -o default -F _ground_rosrun rosrun
