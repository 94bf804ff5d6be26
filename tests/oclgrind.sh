#!/bin/sh
# oclgrind.sh COMMAND [ARGUMENT ...]: runs a command on Oclgrind's device and fails if the command fails or if Oclgrind
# has anything to say. (Oclgrind itself exits with 0 whatever it finds. Its check for uninitialised values is left out:
# version 21.10 crashes in it on vectors that shrink.)
log=$(mktemp)
trap 'rm -f "$log"' EXIT
BROADCL_DEVICE= BROADCL_CACHE_DIR= XDG_CACHE_HOME= HOME= \
  oclgrind --data-races --max-errors 20 --log "$log" "$@" || exit 1
if [ -s "$log" ]; then
  cat "$log"
  exit 1
fi
