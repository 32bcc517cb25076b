#!/bin/bash
# The parts meet where the design says: who may include whom, and what libslf needs to run.
set -u
count=0
none() { # WHAT, and what was found against it
  count=$((count + 1))
  if [ -z "$2" ]; then echo "ok $count - $1"; else echo "not ok $count - $1:" $2; fi
}
includes() { # FROM FOLDER...: headers of those folders that FROM's sources include
  local from=$1 folder header name; shift
  for folder; do
    for header in "$folder"/*.h; do
      name=${header##*/}
      # A bare name means the header beside the source, where there is one.
      if [ -e "$from/$name" ]; then name=$folder/$name; else name="($folder/)?$name"; fi
      grep -lE "#include \"$name\"" "$from"/*.[ch] | sed "s|$| includes $header|"
    done
  done
}
echo "1..6"
none "codec includes no other part" "$(includes codec bake viewer tests/bench tests/unit)"
none "bake includes codec alone" "$(includes bake viewer tests/bench tests/unit)"
none "viewer includes codec alone" "$(includes viewer bake tests/bench tests/unit)"
none "codec's library includes no package" \
  "$(grep -lE '#include <(png|jpeglib|openexr|GL)' codec/*.[ch] | grep -vE 'codec/(slf_command|image|jpeg_slice|slice_image)\.[ch]')"
none "libslf.so needs the C library alone" \
  "$(readelf -d build/libslf.so.*.*.* | sed -n 's/.*NEEDED.*\[\(.*\)\]/\1/p' | grep -vE '^(libc|libm|ld-linux[-_a-z0-9]*)\.so')"
none "libslf.so shows slf_ names alone" \
  "$(nm -D --defined-only build/libslf.so.*.*.* | awk '{print $3}' | grep -v '^slf_')"
