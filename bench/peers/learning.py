# SPDX-License-Identifier: Apache-2.0
"""How fast does `ppo` learn beside sb3-contrib's RecurrentPPO, with the same network and environment?"""

import collections
import re
import statistics
import subprocess
import time

import citylearn
import numpy as np
from other_projects import missing

AGENTS, SPL, EPISODES = 32, 0.9, 100  # as policy_service counts: the mean SPL of the last 100 training episodes
STEP_COST = 0.05  # to the learner, as agent `features` recommends

# RecurrentPPO's names for what agent `features` recommends for `ppo`; what is not said here is the same by default.
OURS = {"n_steps": 64, "batch_size": 8 * 64, "n_epochs": 2, "learning_rate": 1.5e-3, "gamma": 0.93, "gae_lambda": 0.8,
        "ent_coef": 0.02}


def train_ours(args, seed, parameters):
    """Returns steps/s, and the seconds and steps to SPL .90 or None."""
    command = [args.build / "bench/cases/bench_cases", "training", "--agent", "features", "--learner", "ppo", "--seed",
               seed, "--threads", args.threads, "--evaluate", "summer", "--tasks", 1, "--time-limit", args.time_limit,
               "--set", f"steps={args.steps}", *parameters]
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=True).stdout
    rate = re.search(r"^trained .* ([0-9]+) steps/s", done, re.MULTILINE)
    reached = re.search(r"reached 0\.90 after [0-9]+ episodes, ([0-9]+) steps, ([0-9.]+) s", done)
    return float(rate[1]), (float(reached[2]), int(reached[1])) if reached else None


def make_sb3(world):
    """Returns a function as train_ours for RecurrentPPO."""
    import torch
    from sb3_contrib import RecurrentPPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
    from stable_baselines3.common.vec_env import VecEnv
    from gymnasium.spaces import Box, Discrete

    class Agents(VecEnv):
        """citylearn.VectorEnv with Stable-Baselines3's interface. An observation is what agent `features` sees: 64
        features, goal, previous action (3) and the actions that are allowed (3)."""

        def __init__(self):
            self.envs = citylearn.VectorEnv(agents=AGENTS, autoreset_mode="SameStep", **world)
            self.places = world["frames"]
            size = self.envs.single_observation_space["features"].shape[0] + 7
            super().__init__(AGENTS, Box(-np.inf, np.inf, (size,), np.float32), Discrete(3))
            self.spl = collections.deque(maxlen=EPISODES)

        def flat(self, seen):
            goal = 16 * (seen["goal"][:, None] / self.places - 0.5)
            previous = np.eye(4)[seen["previous_action"]][:, :3]
            return np.concatenate([8 * seen["features"], goal, previous, seen["action_mask"]], 1, dtype=np.float32)

        def reset(self):
            return self.flat(self.envs.reset(seed=self._seeds[0])[0])

        def step_async(self, actions):
            self.envs.send(actions)

        def step_wait(self):
            observation, rewards, terminated, truncated, infos = self.envs.recv()
            ended = terminated | truncated
            given = [{} for _ in range(AGENTS)]
            if ended.any():
                finals = {name: np.stack([infos["final_obs"][i][name] for i in np.flatnonzero(ended)])
                          for name in observation}
                for i, final in zip(np.flatnonzero(ended), self.flat(finals)):
                    given[i] = {"terminal_observation": final, "TimeLimit.truncated": bool(truncated[i])}
                self.spl += list(infos["final_info"]["spl"][ended])
            return self.flat(observation), np.where(rewards < 0, -STEP_COST, rewards), ended, given

        def close(self):
            self.envs.close()

        def get_attr(self, attr_name, indices=None):
            return [None] * AGENTS  # such as render_mode

        def set_attr(self, attr_name, value, indices=None):
            raise AttributeError(attr_name)

        def env_method(self, method_name, *method_args, indices=None, **method_kwargs):
            raise AttributeError(method_name)

        def env_is_wrapped(self, wrapper_class, indices=None):
            return [False] * AGENTS

    class Hidden(BaseFeaturesExtractor):
        """Features and goal -> linear 512, ReLU; the rest is appended."""

        def __init__(self, space):
            super().__init__(space, 512 + 6)
            self.linear = torch.nn.Linear(space.shape[0] - 6, 512)

        def forward(self, observations):
            return torch.cat([torch.relu(self.linear(observations[:, :-6])), observations[:, -6:]], 1)

    class Watch(BaseCallback):
        def __init__(self, envs, limit):
            super().__init__()
            self.watched, self.limit, self.begin, self.reached = envs, limit, time.perf_counter(), None

        def _on_step(self):
            passed = time.perf_counter() - self.begin
            spl = self.watched.spl
            if self.reached is None and len(spl) == EPISODES and np.mean(spl) >= SPL:
                self.reached = passed, self.num_timesteps
            return passed < self.limit

    policy = {"features_extractor_class": Hidden, "lstm_hidden_size": 256, "shared_lstm": True,
              "enable_critic_lstm": False, "net_arch": []}

    def train(args, seed, parameters):
        torch.set_num_threads(args.torch_threads)
        envs = Agents()
        model = RecurrentPPO("MlpLstmPolicy", envs, seed=seed, policy_kwargs=policy, device="cpu", **parameters)
        watch = Watch(envs, args.time_limit)
        model.learn(args.steps, callback=watch)
        rate = model.num_timesteps / (time.perf_counter() - watch.begin)
        envs.close()
        return rate, watch.reached

    return train


def compare(args, world, record_figure):
    reason = missing(("gymnasium", "farama-notifications", "stable-baselines3", "sb3-contrib"),
                     ("torch", "pandas", "matplotlib", "cloudpickle", "typing_extensions", "sb3_contrib"))
    contenders = {
        "ppo": (train_ours, []),
        "ppo, no noise, no place loss": (train_ours, ["noise-frame=0", "noise-place=0", "noise-episode=0",
                                                      "localisation=0", "orientation=0"]),
    }
    if not reason:
        train_sb3 = make_sb3(world)
        contenders["RecurrentPPO, parameters of ppo"] = train_sb3, OURS
        contenders["RecurrentPPO, its own parameters"] = train_sb3, {}
    results = {name: [] for name in contenders}
    for seed in args.seeds:
        for name, (train, parameters) in contenders.items():
            results[name].append(train(args, seed, parameters))
    seeds = ", ".join(map(str, args.seeds))
    print(f"\n{AGENTS} agents, {args.threads} threads, torch's {args.torch_threads}, seeds {seeds}, at most "
          f"{args.steps:,} steps or {args.time_limit:g} s")
    print(f"{'learner':<34} {'steps/s':>9} {'ratio':>7} {'seconds to SPL .90':>20} {'steps':>9}")
    first = statistics.median(rate for rate, _ in results["ppo"])
    for name, runs in results.items():
        rate = statistics.median(rate for rate, _ in runs)
        reached = sorted(one for _, one in runs if one)
        seconds, steps = "not reached", ""
        if 2 * len(reached) > len(runs):
            seconds, steps = (form(value) for form, value in zip(("{:.1f}".format, "{:,}".format),
                                                                 statistics.median_low(reached)))
        print(f"{name:<34} {rate:>9,.0f} {rate / first:>7.3f} {seconds:>20} {steps:>9}", flush=True)
        record_figure(f"{name}, training", rate, "steps/s")
    if reason:
        print(f"skipped: RecurrentPPO: {reason}")
