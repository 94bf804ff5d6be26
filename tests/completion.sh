#!/usr/bin/env bash
# tests/completion.sh PROGRAM COMPLETION: what bash completes in an interactive shell.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
ln -s "$1" "$folder/broadcl"
cp "$2" "$folder/completion"
cd "$folder"
touch boxes.npy

# expect LINE COMPLETED: what LINE becomes if all completions of its last word are inserted.
expect() {
  local keys completed
  keys="PATH=.:\$PATH; source completion; stty -echo"$'\n'"$1"
  keys+=$'\e*\x01echo "[" \x05 "]"\n'  # before the line, and after it
  completed=$(script -qec 'bash --norc --noprofile -i' /dev/null <<< "${keys}exit" | sed -nE 's/^\[ (.*) \]\r$/\1/p')
  [[ $completed == "$2" ]] || { echo "'$1' becomes '$completed', not '$2'" >&2; exit 1; }
}
expect 'broadcl ' 'broadcl check devices pairs replay simulate view'
expect 'broadcl che' 'broadcl check'
expect 'broadcl --' 'broadcl --help --help-all --version'
expect 'broadcl check --' 'broadcl check --device --help --report'
expect 'broadcl check bo' 'broadcl check boxes.npy'
expect 'broadcl check --frob' 'broadcl check --frob'
expect 'broadcl check --device=g' 'broadcl check --device=gpu'
expect 'broadcl check --report bo' 'broadcl check --report boxes.npy'
expect 'broadcl pairs bo' 'broadcl pairs boxes.npy'
expect 'broadcl pairs boxes.npy --o' 'broadcl pairs boxes.npy --out'
expect 'broadcl pairs --algorithm t' 'broadcl pairs --algorithm tiles'
expect 'broadcl simulate --scenario s' 'broadcl simulate --scenario streaming'
expect 'broadcl simulate --broadphase tiles,ora' 'broadcl simulate --broadphase tiles,oracle'
expect 'broadcl simulate --objects b' 'broadcl simulate --objects b'
