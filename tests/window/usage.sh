#!/bin/bash
# slfview's own account of itself: help, man page and keys agree, and a wrong use gets one line.
# usage: usage.sh (from the repository's root; build/slfview exists)
set -u
out=build/tap/usage; mkdir -p "$out"
count=0
check() { # WHAT COMMAND...
  local what=$1; shift; count=$((count + 1))
  if "$@"; then echo "ok $count - $what"; else echo "not ok $count - $what"; fi
}
options() { grep -oE -- '--[a-z][a-z-]+' | sort -u; }
refused() { # EXPECTED ARGUMENTS...: exit 2, one line on stderr that says what was expected, nothing on stdout
  local expected=$1; shift
  build/slfview "$@" > "$out/stdout" 2> "$out/stderr"
  [ $? -eq 2 ] && [ ! -s "$out/stdout" ] && [ "$(wc -l < "$out/stderr")" -eq 1 ] && grep -q -- "$expected" "$out/stderr"
}

echo "1..11"
build/slfview --help | options > "$out/help"
sed 's/\\-/-/g' viewer/slfview.1 | options > "$out/man"
check "help and man page name the same options" diff "$out/help" "$out/man"
build/slfview --list-bindings > "$out/bindings"
check "every key has one meaning" eval '[ -z "$(cut -c1-11 "$out/bindings" | sort | uniq -d)" ]'
check "and says it" eval '! grep -vE "^.{11}  [^ ]" "$out/bindings"'
check "no file" refused "expected FILE.slf"
check "no such option" refused "no such option" --nonsense x.slf
check "a value that is none" refused "expected WIDTHxHEIGHT" --size 10 x.slf
check "no value" refused "expected a value" x.slf --cache
check "a back end that has no window" refused "expected glfw" x.slf --backend egl
check "a mix that is none" refused "depth or four-tap" x.slf --mix five
check "a level that is none" refused "0 to 8" x.slf --detail 9
build/slfview nowhere.slf --output "$out/x.png" > "$out/stdout" 2> "$out/stderr"; rc=$?
check "a file that is not there is exit 1 and one line with its name" eval \
  '[ $rc -eq 1 ] && [ "$(wc -l < "$out/stderr")" -eq 1 ] && grep -q nowhere.slf "$out/stderr"'
