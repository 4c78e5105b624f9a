#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# links.sh BENCH_RANKS RANKS [RATE]: shares the numbers of `features` among ranks in network namespaces whose links have
# this rate (1gbit; none: no limit). Needs root. It leaves nothing behind.
set -eu
bench=$1 ranks=$2 rate=${3:-1gbit} name=ranks$$
remove() {
  for ((i = 0; i < ranks; ++i)); do ip netns del "$name-$i" 2>/dev/null || true; done
  ip netns del "$name" 2>/dev/null || true
}
trap remove EXIT
ip netns add "$name"
ip -n "$name" link add br0 type bridge
ip -n "$name" link set br0 up
for ((i = 0; i < ranks; ++i)); do
  ip netns add "$name-$i"
  ip -n "$name" link add "port$i" type veth peer name eth0 netns "$name-$i"
  ip -n "$name" link set "port$i" master br0 up
  ip -n "$name-$i" addr add "10.99.0.$((i + 1))/24" dev eth0
  ip -n "$name-$i" link set eth0 up
  ip -n "$name-$i" link set lo up
  [ "$rate" = none ] && continue
  ip netns exec "$name-$i" tc qdisc add dev eth0 root tbf rate "$rate" burst 256kb latency 20ms
  ip netns exec "$name" tc qdisc add dev "port$i" root tbf rate "$rate" burst 256kb latency 20ms
done
peers=$(for ((i = 1; i <= ranks; ++i)); do echo "10.99.0.$i"; done | paste -sd,)
for ((i = ranks - 1; i >= 0; --i)); do
  ip netns exec "$name-$i" "$bench" --share 2477586 --ranks "$ranks" --rank "$i" \
    --interface eth0 --peers "$peers" &
done
wait
