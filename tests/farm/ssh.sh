#!/bin/bash
# Two private sshds on loopback pose as two hosts that GNU parallel bakes a scene on; one is killed with
# all that runs on it, in mid-bake. The .slf must be the local bake's, byte for byte.
set -u
count=0
ok() { count=$((count + 1)); echo "ok $count - $1"; }
not_ok() { count=$((count + 1)); echo "not ok $count - $1"; for log in "$root"/*.log build/bake/farm-ssh/farm.log; do [ -s "$log" ] && tail -n 8 "$log" | sed "s|^|# ${log##*/}: |"; done; }
check() { if eval "$2"; then ok "$1"; else not_ok "$1"; fi; }
echo 1..5

sshd=$(PATH=$PATH:/usr/sbin command -v sshd)
if [ -z "$sshd" ] || ! command -v parallel > /dev/null; then
  sudo=$([ "$(id -u)" = 0 ] || echo sudo)
  $sudo apt-get -qq update > /dev/null && DEBIAN_FRONTEND=noninteractive $sudo apt-get install -qq -y \
    --no-install-recommends openssh-server parallel > /dev/null 2>&1
  # The package starts a server for the world, which nobody asked for.
  [ -n "$sshd" ] || [ ! -d /run/systemd/system ] || $sudo systemctl disable --quiet --now ssh
  sshd=/usr/sbin/sshd
fi

root=$(mktemp -d /tmp/slf-ssh.XXXXXX)
# A host's processes, its sshd first, so that nothing new begins.
host_processes() {
  echo "$1"
  for child in $(ps -o pid= --ppid "$1"); do host_processes "$child"; done
}
# shellcheck disable=SC2046 # a list of ids
kill_host() { kill -9 $(host_processes "$1"); wait "$1"; } 2> /dev/null
hosts=()
end() {
  for host in "${hosts[@]}"; do kill_host "$host"; done
  rm -rf "$root" build/bake/farm-ssh build/bake/farm-local build/farm-ssh.slf build/farm-local.slf
}
trap end EXIT
ssh-keygen -q -t ed25519 -N '' -f "$root/host_key"
ssh-keygen -q -t ed25519 -N '' -f "$root/user_key"
# As root, sshd wants this folder, which the package's own service makes.
[ "$(id -u)" != 0 ] || mkdir -p /run/sshd
base=$((20000 + $$ % 20000))
cat > "$root/config" <<CONFIG
Host *
  HostName 127.0.0.1
  User $(id -un)
  IdentityFile $root/user_key
  IdentitiesOnly yes
  UserKnownHostsFile $root/known_hosts
  BatchMode yes
CONFIG
for i in 1 2; do
  port=$((base + i))
  printf 'Host n%d\n  Port %d\n' $i $port >> "$root/config"
  echo "[127.0.0.1]:$port $(cat "$root/host_key.pub")" >> "$root/known_hosts"
  cat > "$root/sshd_config.$i" <<CONFIG
Port $port
ListenAddress 127.0.0.1
HostKey $root/host_key
AuthorizedKeysFile $root/user_key.pub
AuthenticationMethods publickey
StrictModes no
PidFile none
CONFIG
  "$sshd" -D -e -f "$root/sshd_config.$i" 2> "$root/sshd.$i.log" &
  hosts+=($!)
done
export PARALLEL_SSH="ssh -F $root/config" PARALLEL_HOME=$root/parallel
answering() { for i in 1 2; do $PARALLEL_SSH n$i true 2> "$root/log" || return; done; }
for _ in $(seq 50); do answering && break; sleep 0.1; done
check "two hosts answer" answering

bake() { make --no-print-directory bake SCENES=tests/bake SCENE=many QUALITY=paper RAYS=9 "$@"; }
bake NAME=farm-local > "$root/log" 2>&1
check "the local bake" '[ -s build/farm-local.slf ]'

FARM_HOSTS="2/n1 2/n2" FARM_CHUNKS=2 FARM_POLL_S=0.5 bake NAME=farm-ssh FARM=ssh > "$root/log" 2>&1 &
baking=$!
baking_on() { ps -o comm= -p "$(host_processes "$1" | paste -sd,)" | grep -c '^povray'; }
lost=0
for _ in $(seq 300); do
  lost=$(baking_on "${hosts[1]}")
  [ "$lost" -gt 0 ] && break
  kill -0 $baking 2> /dev/null || break
  sleep 0.1
done
kill_host "${hosts[1]}"
check "a host is killed while it bakes" '[ "$lost" -gt 0 ] && kill -0 $baking'
echo "# figure: POV-Rays on the host when it was killed: $lost"
wait $baking
status=$?
check "the bake ends well on the host that is left" '[ $status -eq 0 ] && grep -q "on ssh$" "$root/log"'
check "byte for byte the local one" 'cmp build/farm-ssh.slf build/farm-local.slf'
