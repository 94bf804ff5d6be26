#!/usr/bin/env bash
# rusticl.sh FOLDER COMMAND ...: runs a command with Mesa's rusticl of Debian 13, on llvmpipe, which `scripts/setup rusticl` has
# unpacked into FOLDER. Its libraries need that release's C library, and so its loader; what FOLDER lacks is this system's.
set -euo pipefail
libraries=$(echo "$1"/usr/lib/*-linux-gnu)
clang=$(echo "$1"/usr/lib/llvm-*/lib)
shift
export RUSTICL_ENABLE=llvmpipe OCL_ICD_VENDORS=$libraries/libRusticlOpenCL.so.1 BROADCL_DEVICE=rusticl
exec "$libraries"/ld-linux*.so.* --library-path "$libraries:$clang" "$@"
