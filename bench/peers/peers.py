# SPDX-License-Identifier: Apache-2.0
"""How fast are citylearn's environments beside numpy, its learning beside JAX? peers.py BUILD [ROUNDS]"""

import contextlib
import csv
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

BUILD, ROUNDS = Path(sys.argv[1]).resolve(), int((sys.argv[2:] or [5])[0])
sys.path[:0] = [str(BUILD / "python"), str(Path(__file__).resolve().parents[2] / "tests/support")]

import citylearn
from domain import own_domain

WORLD = {"synthetic_images": 0, "synthetic_frames": 128, "frames": 128}  # 128 places, 64 features each
MASKS = np.array([[1, 1, 0], [1, 1, 1], [1, 0, 1]], np.int8)  # at the first place, between, at the last


class NumpyWalk:
    """The task of citylearn.VectorEnv for `agents` agents, as arrays of numpy; an ended episode's agent begins the next
    one at the next step."""

    def __init__(self, features, agents):
        self.features, self.places, self.num_envs = features, len(features), agents

    def reset(self, *, seed=None):
        self.random = np.random.default_rng(seed)
        self.place = self.random.integers(self.places, size=self.num_envs)
        self.goal = np.zeros(self.num_envs, np.int64)
        self.previous, self.nearest, self.steps = (np.zeros(self.num_envs, np.int64) for _ in range(3))
        self.begin(np.ones(self.num_envs, bool))
        self.ended = np.zeros(self.num_envs, bool)
        return self.observe(), {"position": self.place.copy()}

    def begin(self, which):
        drawn = self.random.integers(self.places - 1, size=self.num_envs)
        self.aim(which, drawn + (drawn >= self.place))

    def aim(self, which, goal):
        """Begins an episode of these agents."""
        self.goal = np.where(which, goal, self.goal)
        self.previous[which], self.steps[which] = 3, 0
        self.nearest = np.where(which, np.abs(self.goal - self.place), self.nearest)

    def step(self, actions):
        begun = self.ended
        if begun.any():
            self.begin(begun)
        wanted = self.place + np.array([0, 1, -1])[actions]
        allowed = (wanted >= 0) & (wanted < self.places)
        self.place = np.where(begun | ~allowed, self.place, wanted)
        self.previous = np.where(begun, 3, np.where(allowed, actions, 0))
        self.steps += ~begun
        distance = np.abs(self.goal - self.place)
        nearer = distance < self.nearest
        self.nearest = np.minimum(distance, self.nearest)
        terminated = ~begun & (distance == 0)
        truncated = ~begun & ~terminated & (self.steps >= self.places)
        rewards = np.where(terminated, 1.0, np.where(nearer | begun, 0.0, -1 / self.places))
        self.ended = terminated | truncated
        return self.observe(), rewards, terminated, truncated, {"position": self.place.copy()}

    def observe(self):
        side = 1 - (self.place == 0) + (self.place == self.places - 1)
        return {"features": self.features[self.place], "goal": self.goal.copy(),
                "previous_action": self.previous.copy(), "action_mask": MASKS[side]}

    def close(self):
        pass


def features_of(world):
    """Returns what is seen at each place, (N, D), from a walk."""
    env = citylearn.VectorEnv(agents=256, services=4, **world)
    observation, infos = env.reset(seed=1)
    features = np.zeros((world["frames"], observation["features"].shape[1]), np.float32)
    seen = np.zeros(world["frames"], bool)
    while not seen.all():
        features[infos["position"]], seen[infos["position"]] = observation["features"], True
        observation, *_, infos = env.step(env.action_space.sample())
    return features


def check_same_task(other, world):
    """Raises AssertionError unless an environment behaves as citylearn.VectorEnv, for the same starts and goals."""
    ours = citylearn.VectorEnv(agents=other.num_envs, **world)
    random = np.random.default_rng(1)
    expected, infos = ours.reset(seed=1)
    other.reset(seed=1)
    other.place, begun = infos["position"].copy(), np.ones(other.num_envs, bool)
    draw = other.begin
    for _ in range(1000):
        other.begin = lambda which: None
        other.aim(begun, expected["goal"])
        observed = other.observe()
        for name, values in expected.items():
            np.testing.assert_array_equal(observed[name], values, name)
        onward = np.where(expected["goal"] > infos["position"], 1, 2)
        actions = np.where(random.random(other.num_envs) < 0.8, onward, random.integers(3, size=other.num_envs))
        begun = ours._ended.copy()
        expected, *results, infos = ours.step(actions)
        for one, another in zip(results, other.step(actions)[1:4]):
            np.testing.assert_allclose(another, one, atol=1e-6)
    other.begin = draw


@contextlib.contextmanager
def over_dds(build, world, middleware):
    """Yields a VectorEnv of an env_service."""
    place = {"middleware": middleware, "domain": own_domain(), "interface": "lo"}
    options = [f"--{name.replace('_', '-')}={value}" for name, value in {**world, **place}.items() if name != "frames"]
    service = subprocess.Popen([build / "env_service/env_service", "--agents=16", "--linger=0", "--log-level=error",
                                *options])
    try:
        env = citylearn.VectorEnv(frames=world["frames"], **place)
        yield env
        env.close()
    finally:
        service.terminate()
        service.wait()


def steps_per_second(env, seconds=0.4):
    actions = np.random.default_rng(1).integers(0, 3, (64, env.num_envs))
    ticks, begin = 0, time.perf_counter()
    while (passed := time.perf_counter() - begin) < seconds:
        for each in actions:
            env.step(each)
        ticks += len(actions)
    return ticks * env.num_envs / passed


def record_figure(name, value):
    """Appends a figure as record_figure of bench/figures.h does."""
    if path := os.environ.get("CITYLEARN_BENCH_FIGURES"):
        with open(path, "a", encoding="utf-8") as out:
            print(json.dumps({"name": name, "value": value, "unit": "steps/s", "better": "higher"}), file=out)


def learning(features, python, steps=163840):
    """Trains the agent `features` by each product of policy_service and by JAX, by turns, and prints medians."""
    place = ["--middleware=cyclonedds", f"--domain={own_domain()}", "--interface=lo", "--log-level=error"]
    off = [f"--{name}=0" for name in ("trainer-noise-episode", "trainer-noise-frame", "trainer-noise-place",
                                      "ppo-localisation", "ppo-orientation")]
    figures = {}
    with tempfile.TemporaryDirectory() as folder:
        np.save(f"{folder}/features.npy", features)
        service = subprocess.Popen([BUILD / "env_service/env_service", "--synthetic-images=0", "--synthetic-frames=128",
                                    "--agents=32", *place])
        for seed in range(1, ROUNDS + 1):
            for math in ("onednn", "onednn_bfloat16"):
                subprocess.run([BUILD / "policy_service/policy_service", "--agent=features", "--train=summer",
                                "--evaluate=summer", "--tasks=1", f"--math={math}", f"--seed={seed}",
                                f"--steps={steps}", f"--output={folder}/run", "--overwrite", *off, *place],
                               check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                with open(f"{folder}/run/metrics.csv", encoding="utf-8") as file:
                    rows = list(csv.DictReader(file))
                reached = next((float(row["wall"]) for row in rows if float(row["spl"] or 0) >= 0.9), None)
                figures.setdefault(math, []).append((steps / float(rows[-1]["wall"]), reached))
            said = subprocess.run([python, Path(__file__).with_name("jax_ppo.py"), f"{folder}/features.npy", str(steps),
                                   str(seed)], check=True, capture_output=True).stdout
            said = json.loads(said)
            figures.setdefault("JAX", []).append((said["steps/s"], said["seconds to SPL .9"]))
        service.terminate()
        service.wait()
    for name, values in figures.items():
        rates, seconds = zip(*values)
        ratio = statistics.median(rate / jax for rate, (jax, _) in zip(rates, figures["JAX"]))
        print(f"learning by {name:<16} {statistics.median(rates):>9,.0f} steps/s, {ratio:.2f} x JAX; s to SPL .9: "
              + " ".join("-" if one is None else f"{one:.1f}" for one in seconds))
        record_figure(f"learning by {name}", statistics.median(rates))


def main():
    features = features_of(WORLD)
    check_same_task(NumpyWalk(features, 64), WORLD)
    with contextlib.ExitStack() as stack:
        envs = {}
        for agents in (16, 256):
            envs["citylearn.VectorEnv", agents] = citylearn.VectorEnv(agents=agents, **WORLD)
            envs["numpy, all agents in arrays", agents] = NumpyWalk(features, agents)
        for middleware in ("cyclonedds", "fastdds"):
            envs[f"citylearn.VectorEnv over {middleware}", 16] = stack.enter_context(over_dds(BUILD, WORLD, middleware))
        rates = {which: [] for which in envs}
        for env in envs.values():
            env.reset(seed=1)
        for _ in range(ROUNDS):
            for which, env in envs.items():
                rates[which].append(steps_per_second(env))
        for env in envs.values():
            env.close()
    print(f"{'environment':<34} {'agents':>6} {'agent-steps/s':>14} {'ratio':>8}")
    for (name, agents), values in sorted(rates.items(), key=lambda one: (one[0][1], -statistics.median(one[1]))):
        ratio = statistics.median(one / ours for one, ours in zip(values, rates["citylearn.VectorEnv", agents]))
        print(f"{name:<34} {agents:>6} {statistics.median(values):>14,.0f} {ratio:>8.3f}")
        record_figure(f"{name}, agents {agents}", statistics.median(values))
    if python := os.environ.get("JAX_PYTHON"):
        learning(features, python)
    else:
        print("learning beside JAX skipped: JAX_PYTHON names no Python that has jax and optax")


if __name__ == "__main__":
    main()
