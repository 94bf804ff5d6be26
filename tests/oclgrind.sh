#!/usr/bin/env bash
# oclgrind.sh COMMAND ...: runs a command under Oclgrind with race detection, and fails when it fails or when Oclgrind finds
# anything. (Oclgrind exits with 0 all the same, and empties its log for each new context, so the log is a pipe. The check
# for uninitialised values is left out: version 21.10 crashes in it on vectors that shrink.)
set -euo pipefail
log=$(mktemp)
trap 'rm -f "$log"' EXIT
exec 4>&1
{ BROADCL_DEVICE='' BROADCL_CACHE_DIR='' XDG_CACHE_HOME='' HOME='' \
  oclgrind --data-races --max-errors 20 --log /dev/fd/3 "$@" 3>&1 >&4 4>&- || echo "the command failed"; } | cat > "$log"
if [ -s "$log" ]; then
  cat "$log"
  exit 1
fi
