#!/usr/bin/env bash
# tests/build_types.sh COMPARE_BUILDS FOLDER: builds the library in a folder with -O2, and as Release, by each compiler; an update
# must not take more than 1.1 times as long as with Release.
set -euo pipefail
program=$(realpath "$1")
mkdir -p "$2"
folder=$(realpath "$2")
cd "$(dirname "$0")/.."
for compiler in g++ clang++; do
  libraries=()
  for type in Release RelWithDebInfo None; do
    build=$folder/$compiler-$type
    {
      cmake -S . -B "$build" -D CMAKE_CXX_COMPILER="$compiler" -D CMAKE_BUILD_TYPE="$type" -D CMAKE_CXX_FLAGS_NONE="-g -O2" \
        -D BUILD_SHARED_LIBS=ON -D BROADCL_BULLET=OFF -D BROADCL_MPI=OFF
      cmake --build "$build" --target broadcl --parallel "$(nproc)"
    } > "$folder/log" 2>&1 || { cat "$folder/log"; exit 1; }
    libraries+=("$build/host/libbroadcl.so")
  done
  "$program" --most 1.1 "${libraries[@]}"
done
