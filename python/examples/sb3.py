# SPDX-License-Identifier: Apache-2.0
"""Trains sb3-contrib's RecurrentPPO on summer, then evaluates it there and in winter: sb3.py [STEPS]"""
import sys

import citylearn  # registers CityLearn-v0
from sb3_contrib import RecurrentPPO
from stable_baselines3.common.env_util import make_vec_env

world = {"synthetic_images": 0, "synthetic_frames": 32, "frames": 16}
envs = make_vec_env("CityLearn-v0", n_envs=8, seed=1, env_kwargs=world)
model = RecurrentPPO("MultiInputLstmPolicy", envs, n_steps=64, seed=1)
model.learn(int(sys.argv[1]) if sys.argv[1:] else 100_000)
state = None

def act(observations, episode_starts):
    global state
    actions, state = model.predict(observations, state, episode_starts)
    return actions

print(citylearn.evaluate(act, traversals=["summer", "winter"], controls=["blind"], name="RecurrentPPO", **world))
