#!/usr/bin/env bash
# tests/two_builds.sh COMPARE_BUILDS LIBBROADCL.SO CXX: the library works in a process in which the symbols of another build are
# global, here of one in which each function aborts.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
echo "#include <stdlib.h>" > "$folder/other.c"
nm --dynamic --defined-only --format=posix "$2" | awk -v map="$folder/other.map" '
  $2 ~ /[TW]/ { split($1, symbol, "@@"); print "void " symbol[1] "(void) { abort(); }"; names[symbol[2]] = names[symbol[2]] symbol[1] ";" }
  END { for (version in names) print version " { global: " names[version] " };" > map }' >> "$folder/other.c"
"$3" -x c -w -shared -fPIC "$folder/other.c" -o "$folder/other.so" "-Wl,--version-script=$folder/other.map"
LD_PRELOAD=$folder/other.so "$1" "$2"
