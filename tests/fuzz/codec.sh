#!/bin/sh
# A short run of each fuzz target over the kept corpus, under ASan and UBSan. `make fuzz` runs longer.
cd "$(dirname "$0")/../.." || exit 1
env -u MAKEFLAGS -u MFLAGS make --no-print-directory fuzz-targets >&2 || exit 1
echo 1..3
n=0
for job in open:1500 blocks:400 round_trip:40; do
  target=${job%:*} runs=${job#*:}
  n=$((n + 1))
  mkdir -p "build/fuzz/$target.new"
  if "build/fuzz/$target" -runs="$runs" -seed=1 -max_len=8192 -timeout=20 -rss_limit_mb=4096 \
      -artifact_prefix="build/fuzz/$target-" "build/fuzz/$target.new" "tests/fuzz/corpus/$target" \
      > "build/fuzz/$target.log" 2>&1; then
    echo "ok $n - fuzz $target: $(grep -o 'cov: [0-9]*' "build/fuzz/$target.log" | tail -n 1)"
  else
    tail -n 30 "build/fuzz/$target.log" >&2
    echo "not ok $n - fuzz $target"
  fi
done
