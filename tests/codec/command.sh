#!/bin/sh
# The slf command: what it prints, what it writes, how it fails.
cd "$(dirname "$0")/../.." || exit 1
slf=build/slf file=tests/fuzz/corpus/open/3.slf
out=build/tap/command; rm -rf "$out"; mkdir -p "$out"
n=0
check() { # WHAT, then a command that must succeed
  n=$((n + 1)); what=$1; shift
  if "$@" > "$out/$n.out" 2> "$out/$n.err"; then echo "ok $n - $what"; else echo "not ok $n - $what"; cat "$out/$n.err" >&2; fi
}
refuses() { # EXIT_STATUS WORD WHAT, then a command that must fail so, with one line that has the word
  n=$((n + 1)); status=$1 word=$2 what=$3; shift 3
  "$@" > "$out/$n.out" 2> "$out/$n.err"; got=$?
  if [ $got = "$status" ] && [ "$(wc -l < "$out/$n.err")" = 1 ] && grep -q "^slf: .*$word" "$out/$n.err"; then
    echo "ok $n - $what"
  else
    echo "not ok $n - $what (exit $got)"; cat "$out/$n.err" >&2
  fi
}
echo 1..29
check "help on stdout" sh -c "$slf --help | grep -q '^usage'"
check "info names surface and scheme" sh -c "$slf info $file | grep -q 'angular layered'"
check "verify finds a good file good" $slf verify $file
check "a slice as a picture" $slf slice $file s 2 2 "$out/slice.png"
check "all slices" $slf decode $file s "$out/slices"
check "each slice that exists, once" sh -c "[ \$(ls $out/slices | wc -l) = 25 ]"
check "code again at a PSNR" $slf encode --angular=none --target-psnr=35 --threads=2 $file "$out/none.slf"
check "what came out is near it" sh -c "$slf compare $file $out/none.slf | awk '/^all/{good = \$2 > 34.5 && \$2 < 36} END{exit !good}'"
check "a slice as a JPEG" $slf slice --jpeg "$out/none.slf" s 2 2 "$out/slice.jpg"
check "a file equals itself" sh -c "$slf compare $file $file | grep -q '^all  inf'"
check "a folder of slices beside its file: codes come back from PNG as they were" sh -c "$slf compare $file $out/slices | grep -q '^all  inf'"
check "a file beside a folder, one layer named" sh -c "$slf compare --surface=s --layer=0 $out/slices $out/none.slf | awk '/^all/{good = \$2 > 34.5 && \$2 < 36} END{exit !good}'"
check "a slice as OpenEXR" $slf slice $file s 2 2 "$out/slice.exr"
check "all slices as OpenEXR" $slf decode --exr $file s "$out/exr"
check "a folder of OpenEXR slices as a light field" $slf encode --angular=none --quality=100 --surface=s "$out/exr" "$out/folder.slf"
# Halves round to 1/2048 of a code at most, quality 100 to about one code: 45 dB or better.
check "it is what was decoded" sh -c "$slf compare $file $out/folder.slf | awk '/^all/{good = \$2 > 45} END{exit !good}'"
check "a folder of PNG slices, HDR" sh -c "$slf encode --hdr $out/slices $out/hdr.slf && $slf info $out/hdr.slf | grep -q 'HDR, 10x10 texels, 5x5 directions'"
check "two folders" sh -c "$slf compare $out/slices $out/exr | awk '/^all/{good = \$2 == \"inf\" || \$2 > 60} END{exit !good}'"
refuses 2 "expected --surface=S" "compare takes no other option" $slf compare --quality=3 "$out/slices" "$out/exr"
rm "$out/exr/002_002.exr"
refuses 1 "002_002.exr" "a slice that is missing from a folder to compare" $slf compare $file "$out/exr"
refuses 1 "002_002.exr" "a slice that is missing" $slf encode "$out/exr" "$out/no.slf"
refuses 1 "expected .exr or .png" "a picture of another kind" $slf slice $file s 2 2 "$out/slice.gif"
head -c 1000 $file > "$out/short.slf"
refuses 1 "1000 bytes" "a file cut short" $slf info "$out/short.slf"
refuses 1 "none.slf.*no slice" "a slice that does not exist" $slf slice "$out/none.slf" s 9 9 "$out/no.png"
refuses 1 "3x3 directions; .* has 10x10, 5x5" "layers of other sizes" $slf compare "$out/slices" tests/fuzz/corpus/open/5.slf
refuses 1 "no surface" "a surface that does not exist" $slf slice $file nothing 2 2 "$out/no.png"
refuses 1 "angular none" "a JPEG of predicted blocks" $slf slice --jpeg $file s 2 2 "$out/no.jpg"
refuses 2 "frobnicate" "a verb that does not exist" $slf frobnicate
refuses 2 "quality=0" "a quality out of range" $slf encode --quality=0 $file "$out/no.slf"
