# SPDX-License-Identifier: Apache-2.0
"""Environments with Gymnasium's interface (1.x)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from ._options import _native, as_text, check_process, count, none_is_default, route_of, seconds, seed_of
from ._render import Painter
from ._spaces import AutoresetMode, Discrete, EnvBase, VectorEnvBase, batch_space, observation_space

STAY, NEXT, PREVIOUS = 0, 1, 2
LEFT, FORWARD, RIGHT = 0, 1, 2  # on streets
_MOST_SERVICES = 4096
_WAIT = 255  # at the start of an episode: nothing of the agent changes
_TERMINATED, _TRUNCATED, _LATER_GOAL = 2, 4, 16

_RENDERING = {"render_modes": ["rgb_array"], "render_fps": 4}

Observation = dict[str, np.ndarray]


class VectorEnv(VectorEnvBase):
    """Agents on one route of a traversal: agents x services of them, in this process or in env_services over DDS.

    An agent stands at one of the route's N places and is to reach another. It stays (0), goes on (1) or back (2). A
    step that leads nearer to the goal than any before costs nothing, any other 1 / max_steps. Reaching the goal is
    worth 1 and terminates the episode; max_steps steps truncate it. An action that leads off the route counts as 0.
    With goals=3 each of three goals is worth 1; the next replaces it in the observation, the last ends the episode.

    Where the traversal has a map of streets, it stands at a place and faces a heading: one of N states. It turns left
    (0), goes forward (1) or turns right (2), and is to reach a place in whatever state. What it cannot do counts as the
    first action that it can.

    Observations, for B = num_envs agents, are new arrays at each step:
      features         float32 (B, D)  of the frame that the agent sees
      goal             int64 (B,)      place to reach, 0..N-1; on streets one of their places
      previous_action  int64 (B,)      0..2, or 3 at the start of an episode
      action_mask      int8 (B, 3)     1 where the action stays on the route
    Infos: `position` int64 (B,), the place or state stood at, on streets `heading` float32 (B,), degrees clockwise from
    north, with several goals `later_goals` int64 (B,), how many follow the present one, and `spl` float64 (B,) where an
    episode ended, success weighted by path length; each with its mask `_position`, `_heading`, `_later_goals`, `_spl`.
    The same seed gives the same observations in process and over DDS, whatever the middleware.
    """

    @none_is_default
    def __init__(self, *, num_envs: int | None = None, agents: int | None = None, services: int | None = None,
                 frames: int | str | None = None, max_steps: int = 0, max_detour: int | None = None,
                 shuffle: bool = False,
                 autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, wait: float = 30,
                 render_mode: str | None = None, **options: Any):
        """Loads the traversal, or finds the env_services. None leaves an argument out.

        agents: of each service, 1..256, 16 by default; over DDS the env_services say how many.
        services: environments that step together, each with random numbers of its own; 1 by default.
        num_envs: agents x services, for gymnasium.make_vec; alone it makes so many services of one agent.
        frames: the route, a number of frames from the first on or "FIRST:END"; the first 128 by default.
          Streets are walked as a whole.
        max_steps: step limit of an episode, for each of its goals; 0: as many as the route has places.
        max_detour: likewise in multiples of its fewest steps; 0: none. By default 3 on streets, 0 on a line.
        shuffle: show the frames in a random order, another one in each episode; the place where an episode begins
          keeps its frame of the last episode, which ended there.
        wait: seconds until a missing or silent env_service raises TimeoutError.
        render_mode: "rgb_array" makes render() draw, in this process alone.
        options: those of env_service (dataset, data, traversal, step_metres, slip ...) and, for pictures, of
          encoder_service (encoder, dimension ...), with _ for -. With one of a service's own (session, middleware,
          domain, interface, peers ...) the env_services that host `traversal` there are driven instead.
        """
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, **_RENDERING, "autoreset_mode": self.autoreset_mode}
        if "max_episode_steps" in options:
            raise TypeError("max_episode_steps cuts no episode here; give max_steps, by which rewards scale too")
        self._remote = bool(options.keys() & set(_native.node_options()))
        self.render_mode = render_mode
        if render_mode not in (None, *([] if self._remote else _RENDERING["render_modes"])):
            # A TypeError makes Stable-Baselines3 leave it out.
            raise TypeError(f"render_mode must be None{' over DDS' if self._remote else ' or rgb_array'}, is "
                            f"{render_mode!r}")
        if num_envs is not None and agents is None and services is None and not self._remote:
            agents, services = 1, count("num_envs", num_envs, 1, _MOST_SERVICES)
        services = count("services", 1 if services is None else services, 1, _MOST_SERVICES)
        wait = seconds("wait", wait)
        self._process = os.getpid()
        if self._remote:
            texts = as_text(options)
            self._envs = _native.Envs(texts, texts.pop("traversal", "summer"), services, wait)
        else:
            recording = _native.Recording(as_text(options))
            self._envs = _native.Envs(recording, count("agents", 16 if agents is None else agents, 1, 256), services)
        self._route = route_of(frames, max_steps, shuffle, max_detour, self._envs, self._envs.traversal)
        self._places, self._headings = self._envs.states
        self._painter = Painter(recording, self._route, self._places) if render_mode else None
        self.num_envs: int = self._envs.agents
        self.single_observation_space = observation_space(
            self._envs.features, int(self._places[-1]) + 1 if len(self._places) else self._route.frames)
        self.single_action_space = Discrete(3)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        if num_envs is not None and count("num_envs", num_envs, 1) != self.num_envs:
            raise ValueError(f"num_envs is {num_envs}, but {services} services have {self.num_envs} agents")
        self._rows = np.arange(self.num_envs)
        self._service = np.repeat(np.arange(services), self._envs.service_agents)  # of each agent
        self._steps, self._start = np.zeros((2, self.num_envs), np.int64)
        self._goals: list[list[int]] = [[] for _ in range(self.num_envs)]  # of each agent's episode, so far
        self._courier = False  # tasks have several goals
        self._ended = np.zeros(self.num_envs, bool)
        self._ready = False  # agents have been reset
        self._sent: np.ndarray | None = None  # the actions under way

    def reset(self, *, seed: int | Sequence[int | None] | None = None,
              options: dict[str, Any] | None = None) -> tuple[Observation, dict[str, Any]]:
        """Begins anew: service i draws from seed + i, or from seed[i]. Without a seed, from the next of the
        environment's own.

        options["reset_mask"], bool (B,): only these agents begin an episode. One whose last has ended begins its next.
        Where an episode goes on, or with a seed, the service begins anew, and so all of its agents must be in the mask.
        """
        self._check_open()
        if self._sent is not None:
            raise RuntimeError("reset() between send() and recv(); call recv() first")
        seeds, given = self._seeds(seed), (options or {}).get("reset_mask")
        mask = self._reset_mask(given)
        anew = np.full(len(seeds), given is None or not self._ready)  # by service
        seeded = np.array([one is not None for one in seeds])[self._service]
        anew[self._service[mask & (seeded | ~self._ended)]] = True
        begins = anew[self._service]
        if (begins & ~mask).any():
            raise ValueError(f"reset_mask: agent {int(np.argmax(begins & ~mask))} is not in the mask, but in a service "
                             "that begins anew; mask all of its agents, or make services of one agent")
        super().reset(seed=next((one for one in seeds if one is not None), None))
        if anew.any() and None in seeds:
            drawn = int(self.np_random.integers(2**63))
            seeds = [drawn + i if one is None else one for i, one in enumerate(seeds)]
        self._ready = False
        observation, position, _, _ = self._unpack(self._envs.reset(
            self._route, [one if new else None for one, new in zip(seeds, anew)]))
        self._begin(begins, position)
        self._courier |= bool((self._flags >= _LATER_GOAL).any())
        self._ended &= ~mask
        for name, values in self._final.items() if self._ended.any() else ():
            observation[name] = np.where(self._ended, values, observation[name])
        self._ready = True
        self._shown = self._painter and (self._frame, position.copy(), observation["goal"].copy())
        return observation, self._infos(position, mask)

    def step(self, actions: Any) -> tuple[Observation, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Steps all agents by actions, whole numbers (B,). Returns observations, rewards float64 (B,), terminations and
        truncations bool (B,), infos. What follows an episode's end is as the autoreset mode says."""
        chosen = self._choose(actions)
        return self._finish(chosen, self._call(self._envs.step, chosen))

    def send(self, actions: Any) -> None:
        """Begins step(actions), which goes on beside Python until recv() returns its result."""
        chosen = self._choose(actions)
        self._envs.send(chosen)
        self._sent = chosen

    def recv(self) -> tuple[Observation, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Waits for what send() began, and returns what step() would."""
        self._check_open()
        if self._sent is None:
            raise RuntimeError("recv() without send()")
        chosen, self._sent = self._sent, None
        return self._finish(chosen, self._call(self._envs.receive))

    def action_masks(self) -> np.ndarray:
        """Returns the action_mask of the last observation, bool (B, 3)."""
        if not self._ready:
            raise RuntimeError("call reset() first")
        return self._mask.astype(bool)

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Returns a picture of each agent, uint8 (H, W, 3): the frame that it sees and, beside it, the goal's, or their
        features as grey tiles; below them the route with its place (red) and the goal (green). None without
        render_mode="rgb_array"."""
        if self._painter is None:
            return None
        if not self._ready:
            raise RuntimeError("call reset() first")
        return tuple(self._painter.draw(*of_agent) for of_agent in zip(*self._shown))

    def close_extras(self, **kwargs: Any) -> None:
        """Releases the env_services."""
        del self._envs

    def _check_open(self) -> None:
        if self.closed:
            raise RuntimeError("the environment is closed; make a new one")
        if self._remote or self._sent is not None:  # its threads are not in processes that are forked
            check_process(self._process, "the environment")

    def _call(self, step: Any, *arguments: Any) -> Any:
        """Calls a step; after an error or an interrupt agents must be reset."""
        self._ready = False
        result = step(*arguments)
        self._ready = True
        return result

    def _choose(self, actions: Any) -> np.ndarray:
        """Returns checked actions as agents do them."""
        self._check_open()
        if self._sent is not None:
            raise RuntimeError("a step is under way; call recv() first")
        if not self._ready:
            raise RuntimeError("call reset() first")
        actions = np.asarray(actions)
        if actions.shape != (self.num_envs,):
            raise ValueError(f"actions have shape {actions.shape}, must have ({self.num_envs},): one per agent")
        if actions.dtype.kind not in "iu":
            raise TypeError(f"actions are {actions.dtype}, must be whole numbers")
        if actions.min() < 0 or actions.max() > PREVIOUS:
            agent = int(np.argmax((actions < 0) | (actions > PREVIOUS)))
            names = ("left", "forward", "right") if len(self._places) else ("stay", "next", "previous")
            raise ValueError(f"action {actions[agent]} of agent {agent} must be 0 ({names[0]}), 1 ({names[1]}) or 2 "
                             f"({names[2]})")
        chosen = np.where(self._mask[self._rows, actions], actions, self._mask.argmax(axis=1)).astype(np.uint8)
        if self.autoreset_mode == AutoresetMode.NEXT_STEP:
            chosen[self._ended] = _WAIT
        elif self.autoreset_mode == AutoresetMode.DISABLED and self._ended.any():
            raise RuntimeError(f"the episode of agent {int(np.argmax(self._ended))} has ended; call "
                               "reset(options={'reset_mask': terminations | truncations})")
        return chosen

    def _unpack(self, columns: tuple[np.ndarray, ...]) -> tuple[Observation, np.ndarray, np.ndarray, np.ndarray]:
        """Returns observation, position, reward and flags, and keeps what the next step needs."""
        features, goal, previous_action, mask, position, reward, flags, self._frame = columns
        # Copies, because callers may write into theirs.
        self._goal, self._mask, self._flags = goal.copy(), mask.copy(), flags
        return {"features": features, "goal": goal, "previous_action": previous_action,
                "action_mask": mask}, position, reward, flags

    def _finish(self, chosen: np.ndarray, columns: tuple[np.ndarray, ...]) -> Any:
        goal_before = self._goal
        observation, position, rewards, flags = self._unpack(columns)
        terminated, truncated = (flags & _TERMINATED) != 0, (flags & _TRUNCATED) != 0
        ended = terminated | truncated
        self._ended = ended & (self.autoreset_mode != AutoresetMode.SAME_STEP)  # and do not yet begin the next
        self._steps += chosen != _WAIT
        for agent in np.flatnonzero((self._goal != goal_before) & ~ended):
            self._goals[agent].append(int(self._goal[agent]))
        infos = self._infos(position, np.ones(self.num_envs, bool))
        if ended.any():
            self._final = {"goal": np.where(ended, goal_before, observation["goal"]),
                           "previous_action": np.where(ended, chosen, observation["previous_action"])}
            final = {**observation, **{name: values.copy() for name, values in self._final.items()}}
            spl = np.zeros(self.num_envs)
            for agent in np.flatnonzero(terminated):
                shortest = self._envs.fewest_steps(self._start[agent], self._goals[agent])
                spl[agent] = shortest / max(self._steps[agent], shortest)
            self._begin(ended, position)
            if self.autoreset_mode == AutoresetMode.SAME_STEP:
                infos["final_obs"] = np.full(self.num_envs, None, object)
                for agent in np.flatnonzero(ended):
                    infos["final_obs"][agent] = {name: values[agent] for name, values in final.items()}
                infos["final_info"] = {"position": np.where(ended, position, 0), "_position": ended.copy(),
                                       "spl": spl, "_spl": ended.copy()}
                infos["_final_obs"], infos["_final_info"] = ended.copy(), ended.copy()
            else:
                observation = final
                infos["spl"], infos["_spl"] = spl, ended.copy()
        self._shown = self._painter and (self._frame, position.copy(), observation["goal"].copy())
        return observation, rewards, terminated, truncated, infos

    def _begin(self, begins: np.ndarray, position: np.ndarray) -> None:
        """Notes what the agents that begin an episode have done so far."""
        self._steps[begins] = 0
        self._start[begins] = position[begins]
        for agent in np.flatnonzero(begins):
            self._goals[agent] = [int(self._goal[agent])]

    def _infos(self, position: np.ndarray, mask: np.ndarray) -> dict[str, Any]:
        infos = {"position": np.where(mask, position, 0), "_position": mask.copy()}
        if len(self._places):
            infos |= {"heading": np.where(mask, self._headings[position], 0), "_heading": mask.copy()}
        if self._courier:
            infos |= {"later_goals": np.where(mask, self._flags // _LATER_GOAL, 0).astype(np.int64),
                      "_later_goals": mask.copy()}
        return infos

    def _seeds(self, seed: Any) -> list[int | None]:
        """Returns one seed, or None, for each service."""
        services = len(self._envs.service_agents)
        if np.ndim(seed):
            if len(seed) != services:
                raise ValueError(f"seed must be one number or a list of {services}, one for each service, has "
                                 f"{len(seed)}")
            return [None if one is None else seed_of(one) for one in seed]
        return [None if seed is None else (seed_of(seed) + i) % 2**64 for i in range(services)]

    def _reset_mask(self, mask: Any) -> np.ndarray:
        """Returns the agents that begin an episode."""
        if mask is None:
            return np.ones(self.num_envs, bool)
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
            raise TypeError("reset_mask must be a numpy array of bool")
        if mask.shape != (self.num_envs,):
            raise ValueError(f"reset_mask has shape {mask.shape}, must have ({self.num_envs},)")
        if not mask.any():
            raise ValueError("reset_mask must name an agent")
        if not self._ready and not mask.all():
            raise RuntimeError("call reset() for all agents first")
        return mask


class Env(EnvBase):
    """One agent, with Gymnasium's interface of a single environment. Options, observations and infos as VectorEnv's."""

    metadata: dict[str, Any] = _RENDERING

    @none_is_default
    def __init__(self, **options: Any):
        self._envs = VectorEnv(**{"agents": 1, "autoreset_mode": AutoresetMode.DISABLED, **options})
        if self._envs.num_envs != 1:
            raise ValueError(f"Env has one agent, these are {self._envs.num_envs}; use VectorEnv")
        self.render_mode = self._envs.render_mode
        self.observation_space = self._envs.single_observation_space
        self.action_space = self._envs.single_action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        ended = self._envs._ready and seed is None and self._envs._ended.all()
        observation, infos = self._envs.reset(seed=seed, options={"reset_mask": np.ones(1, bool)} if ended else None)
        return self._only(observation), self._only(infos)

    def step(self, action: Any) -> Any:
        action = np.asarray(action)
        if action.size != 1:
            raise ValueError(f"the action has shape {action.shape}, must be one whole number")
        observation, rewards, terminated, truncated, infos = self._envs.step(action.reshape(1))
        return (self._only(observation), float(rewards[0]), bool(terminated[0]), bool(truncated[0]), self._only(infos))

    def action_masks(self) -> np.ndarray:
        """Returns the action_mask of the last observation, bool (3,)."""
        return self._envs.action_masks()[0]

    def render(self) -> np.ndarray | None:
        """Returns VectorEnv.render()'s picture."""
        pictures = self._envs.render()
        return pictures and pictures[0]

    def close(self) -> None:
        self._envs.close()

    @staticmethod
    def _only(values: dict[str, Any]) -> dict[str, Any]:
        return {name: array[0] for name, array in values.items() if not name.startswith("_")}
