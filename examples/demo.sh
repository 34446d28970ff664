#!/bin/sh
# The main job, on the example of the paper: experiments in a file → identified model → validation on fresh
# experiments; then all of the paper's figures and printed numbers. Every file that it makes stays in OUT.
#
#   examples/demo.sh [BIN [OUT]]      BIN: directory of the built programs; OUT: a directory of the demo's own
set -eu
root=$(dirname "$0")/..
bin=${1:-$root/build/bin}
out=${2:-$root/build/demo}

heading() { printf '\n\033[1m%s\033[0m\n' "$1"; }
[ -t 1 ] || heading() { printf '\n== %s\n' "$1"; }
run() {
  echo "\$ $*"
  program=$1
  shift
  "$bin/$program" "$@"
}

mkdir -p "$out"

heading "1. Ten experiments of a time varying oscillator, and eight free responses, into a file"
run tokid example oscillator -o "$out/ensemble.npz" --experiments 10 --steps 80 --free-responses 8 --seed 1
run tokid info "$out/ensemble.npz"

heading "2. Identify A, B, C, D and the observer gain G of every step"
run tokid identify "$out/ensemble.npz" -o "$out/model.npz" --lags 2 --states 4

heading "3. Validate on fresh experiments"
run tokid example oscillator -o "$out/fresh.h5" --experiments 10 --steps 80 --seed 2
run tokid validate "$out/model.npz" "$out/fresh.h5"

heading "4. The figures of the paper, and its printed numbers beside the computed ones"
run tokid paper -o "$out/paper"

heading "Files"
for file in ensemble.npz model.npz fresh.h5 paper/paper.html; do
  case $file in
    ensemble.npz) what="the ten experiments and eight free responses" ;;
    model.npz) what="the identified model" ;;
    fresh.h5) what="the ten experiments it was validated on" ;;
    paper/paper.html) what="the paper, recomputed: open it in a browser" ;;
  esac
  printf '%s/%-17s %s\n' "$out" "$file" "$what"
done
