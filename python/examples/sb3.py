# SPDX-License-Identifier: Apache-2.0
"""Trains Stable-Baselines3's RecurrentPPO on one recording and evaluates it on two: sb3.py [STEPS]"""
import sys

import citylearn
from sb3_contrib import RecurrentPPO
from stable_baselines3.common.env_util import make_vec_env

world = {"synthetic_images": 0, "synthetic_frames": 32}
envs = make_vec_env(lambda: citylearn.Env(frames=16, **world), n_envs=8, seed=1)
model = RecurrentPPO("MultiInputLstmPolicy", envs, n_steps=64, seed=1)
model.learn(int(sys.argv[1]) if len(sys.argv) > 1 else 200_000)

state = None
def act(observations, episode_starts):
    global state
    actions, state = model.predict(observations, state, episode_starts)
    return actions

for traversal in ("summer", "winter"):
    state = None
    print(citylearn.evaluate(act, name="RecurrentPPO", traversal=traversal, controls=["blind"], tasks=200, frames=16, **world))
