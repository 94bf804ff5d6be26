# shellcheck shell=bash
# Completion for bash. The verbs, options and names are those that the program's help lists.
_broadcl() {
  local last=${2##*,} before=$3 verb=() help section='' words=''
  [[ $before != = ]] || before=${COMP_WORDS[COMP_CWORD - 2]}
  ((COMP_CWORD == 1)) || verb=("${COMP_WORDS[1]}")
  help=$("$1" "${verb[@]}" --help 2> /dev/null)
  COMPREPLY=()
  case $before in
    --scenario) section=Scenarios ;;
    --broadphase) section='Broad phases' ;;
    --algorithm) section=Algorithms ;;
    --device) words='gpu cpu accelerator' ;;
    *)
      if [[ $before == --* && $help =~ [[:space:]]"$before "([A-Z]+) ]]; then
        [[ ${BASH_REMATCH[1]} != FILE ]] || compopt -o default
        return
      elif [[ $2 == -* || $help != *'[OPTIONS] '?('[')FILE* ]]; then
        words=$(sed -nE 's/^ +(-h, *)?(--[a-z-]+).*/\2/p' <<< "$help")
        [[ $2 == -* || ${#verb[@]} -gt 0 ]] || section=Verbs
      else
        compopt -o default
        return
      fi
      ;;
  esac
  [[ -z $section ]] || words=$(sed -nE "/^$section:\$/,/^(\$|[^ ])/ s/^  ([^ ]+) .*/\1/p" <<< "$help")
  mapfile -t COMPREPLY < <(compgen -P "${2%"$last"}" -W "$words" -- "$last")
}
complete -F _broadcl broadcl
