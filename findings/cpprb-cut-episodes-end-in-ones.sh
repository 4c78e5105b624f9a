#!/usr/bin/env bash
# cpprb 11.0.0 keeps experience for learning over n steps: `rew` sums n rewards, `next_obs` is the observation n steps
# on, from which the value of the rest is taken. Episodes end by `done` or are cut by a limit of steps; the help of
# on_episode_end() says that it moves what is left of such an episode into the buffer. One would expect the last n - 1
# steps to have the episode's last observation as `next_obs`. They have ones in all of its places, an observation that
# nobody made. `done` hides this, as nothing is taken from it then; a cut episode has no `done`.
# It hurts those who train agents to walk routes within a limit of steps: they learn the value of a place that does not
# exist, without a word.
# Seen, of two episodes over 50 to 55 and 100 to 105 with n = 3: next_obs 53 54 55 1 1 and 103 104 105 1 1; right in
# place of 1 1 are 55 55 and 105 105. `rew` is right. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cpprb==11.0.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import sys
from cpprb import ReplayBuffer

fields = {name: {} for name in ("obs", "rew", "next_obs", "done")}
steps = {"size": 3, "gamma": 0.5, "rew": "rew", "next": "next_obs"}
buffer = ReplayBuffer(64, fields, Nstep=steps)
for first in (50, 100):
    for place in range(first, first + 5):
        buffer.add(obs=place, rew=1, next_obs=place + 1, done=0)
    buffer.on_episode_end()
stored = {name: values.ravel().tolist() for name, values in buffer.get_all_transitions().items()}
for name in ("obs", "rew", "next_obs"):
    print("cpprb 11.0.0", name, *stored[name])
sys.exit((stored["obs"], stored["rew"], stored["next_obs"]) != (
    [50, 51, 52, 53, 54, 100, 101, 102, 103, 104], 2 * [1.75, 1.75, 1.75, 1.5, 1],
    [53, 54, 55, 1, 1, 103, 104, 105, 1, 1]))
END
