# SPDX-License-Identifier: Apache-2.0
"""How fast are citylearn's environments beside the same task written in Python?"""

import contextlib
import statistics
import subprocess
import time

import citylearn
import numpy as np
from domain import own_domain
from other_projects import missing

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


def make_walk(features):
    """Returns the class of a gymnasium.Env with the task of citylearn.Env, in plain Python."""
    import gymnasium
    from gymnasium.spaces import Box, Dict, Discrete, MultiBinary

    class Walk(gymnasium.Env):
        def __init__(self):
            self.places = len(features)
            self.observation_space = Dict({
                "features": Box(-np.inf, np.inf, features.shape[1:], np.float32), "goal": Discrete(self.places),
                "previous_action": Discrete(4), "action_mask": MultiBinary(3)})
            self.action_space = Discrete(3)
            self.place = None

        def reset(self, *, seed=None, options=None):
            super().reset(seed=seed)
            if self.place is None or seed is not None:
                self.place = int(self.np_random.integers(self.places))
            drawn = int(self.np_random.integers(self.places - 1))
            self.goal = drawn + (drawn >= self.place)
            self.previous, self.steps, self.nearest = 3, 0, abs(self.goal - self.place)
            return self.observe(), {"position": self.place}

        def step(self, action):
            wanted = self.place + (0, 1, -1)[action]
            if 0 <= wanted < self.places:
                self.place, self.previous = wanted, int(action)
            else:
                self.previous = 0
            self.steps += 1
            distance = abs(self.goal - self.place)
            terminated, truncated = distance == 0, distance != 0 and self.steps >= self.places
            reward = 1.0 if terminated else 0.0 if distance < self.nearest else -1 / self.places
            self.nearest = min(distance, self.nearest)
            return self.observe(), reward, terminated, truncated, {"position": self.place}

        def observe(self):
            return {"features": features[self.place], "goal": self.goal, "previous_action": self.previous,
                    "action_mask": MASKS[1 - (self.place == 0) + (self.place == self.places - 1)]}

    return Walk


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


def check_walk(walk, arrays):
    """Raises AssertionError unless a walk of one agent behaves as arrays of one."""
    random = np.random.default_rng(1)
    arrays.reset(seed=1)
    walk.reset(seed=1)
    walk.place = int(arrays.place[0])
    for _ in range(50):
        walk.goal, walk.previous, walk.steps = int(arrays.goal[0]), 3, 0
        walk.nearest, ended = abs(walk.goal - walk.place), False
        while not ended:
            for name, value in walk.observe().items():
                np.testing.assert_array_equal(value, arrays.observe()[name][0], name)
            onward = 1 if walk.goal > walk.place else 2
            action = onward if random.random() < 0.8 else int(random.integers(3))
            _, *results, _ = walk.step(action)
            for one, another in zip(results, arrays.step(np.array([action]))[1:4]):
                np.testing.assert_allclose(another[0], one, atol=1e-6)
            ended = results[1] or results[2]
        arrays.step(np.array([0]))  # begins the next episode


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


def compare(build, world, rounds, record_figure):
    features = features_of(world)
    check_same_task(NumpyWalk(features, 64), world)
    reason = missing(("gymnasium", "farama-notifications"), ("cloudpickle", "typing_extensions", "gymnasium"))
    if not reason:
        from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
        walk = make_walk(features)
        check_walk(walk(), NumpyWalk(features, 1))
    with contextlib.ExitStack() as stack:
        envs = {}
        for agents in (16, 256):
            envs["citylearn.VectorEnv", agents] = citylearn.VectorEnv(agents=agents, **world)
            envs["numpy, all agents in arrays", agents] = NumpyWalk(features, agents)
            if not reason:
                envs["Gymnasium's SyncVectorEnv", agents] = SyncVectorEnv([walk] * agents)
                if agents == 16:  # each agent is a process
                    envs["Gymnasium's AsyncVectorEnv", agents] = AsyncVectorEnv([walk] * agents)
        for middleware in ("cyclonedds", "fastdds"):
            envs[f"citylearn.VectorEnv over {middleware}", 16] = stack.enter_context(over_dds(build, world, middleware))
        rates = {which: [] for which in envs}
        for env in envs.values():
            env.reset(seed=1)
        for _ in range(rounds):
            for which, env in envs.items():
                rates[which].append(steps_per_second(env))
        for env in envs.values():
            env.close()
    print(f"{'environment':<34} {'agents':>6} {'agent-steps/s':>14} {'quartiles':>20} {'ratio':>8}")
    reference = "citylearn.VectorEnv"
    for (name, agents), values in sorted(rates.items(), key=lambda one: (one[0][1], -statistics.median(one[1]))):
        low, middle, high = statistics.quantiles(values, n=4, method="inclusive") if rounds > 1 else values * 3
        ratio = statistics.median(one / ours for one, ours in zip(values, rates[reference, agents]))
        print(f"{name:<34} {agents:>6} {middle:>14,.0f} {f'{low:,.0f}..{high:,.0f}':>20} {ratio:>8.3f}")
        record_figure(f"{name}, agents {agents}", middle, "steps/s")
    if reason:
        print(f"skipped: Gymnasium's environments: {reason}")
