# SPDX-License-Identifier: Apache-2.0
"""Trained policies and their evaluation."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ._options import _native, as_text, check_number, count, none_is_default, route_of, seed_of

_LOADED = (_native.Agent, _native.ExportedPolicy)
Act = Callable[[dict[str, np.ndarray], np.ndarray], Any]


class Scores(dict):
    """Figures by (policy, traversal): tasks, completed (0..1), spl (0..1), excess, mean_steps, shortest_mean, reward.
    Prints as policy_service's table."""

    def __str__(self) -> str:
        return _native.table([(*key, score) for key, score in self.items()])


def load_policy(path: Any) -> _native.Agent | _native.ExportedPolicy:
    """Returns the agent of a checkpoint (.clk) or of a model that citylearn export wrote (.onnx), with the attributes
    name, features (D), frames (N), first_frame and data: the traversals that it learned from and the options (source)
    that found them, as far as it says. A checkpoint that learned on streets walks any others too, a model those alone.
    Raises FileNotFoundError, or ValueError that names the file."""
    with open(path, "rb"):  # Python's own errors for what cannot be opened
        return (_native.ExportedPolicy if str(path).endswith(".onnx") else _native.Agent)(str(path))


class ActingPolicy:
    """Acts by a policy of load_policy(), with memory of the agents' episodes, as a function that evaluate() takes:
    acting(observations, starts) returns actions (B,) for VectorEnv's observations; starts, bool (B,), says which agents
    begin an episode. What was seen in earlier episodes normalises features in later ones, so take a new one for another
    traversal. `seed` decides the actions drawn. `envs`: the environment that it acts in, whose streets it walks; on a line
    it may be left out."""

    def __init__(self, policy: _native.Agent | _native.ExportedPolicy, seed: int = 1, envs: Any = None):
        if not isinstance(policy, (_native.Agent, _native.ExportedPolicy)):
            raise TypeError(f"policy must be what load_policy() returns, is {type(policy).__name__}")
        if policy.name == "baseline":
            raise ValueError("baseline sees positions, which observations do not have; use another policy")
        envs = getattr(getattr(envs, "unwrapped", envs), "_envs", None)  # of an Env they are a VectorEnv
        streets = getattr(envs, "_envs", envs).streets if envs else _native.Streets()
        if isinstance(policy, _native.Agent) and streets.hash and not policy.learned_on(streets):
            raise ValueError(f"policy '{policy.name}' learned on other streets and knows no views of these")
        self._acting, self._first_frame = _policy_on(policy, seed, streets), policy.first_frame
        self._streets = bool(streets.hash)
        self._steps, self._believed, self._belief, self._lost = 0, -2, None, _native.LostAgents()

    def __call__(self, observations: dict[str, np.ndarray], starts: np.ndarray) -> np.ndarray:
        columns = (observations[name] for name in ("features", "goal", "previous_action", "action_mask"))
        self._steps, self._starts = self._steps + 1, np.array(starts, bool)
        return self._acting.act(*columns, starts, self._first_frame)

    def belief(self) -> dict[str, np.ndarray] | None:
        """Returns where the agents believed to stand when they acted last: `places` (B, 8), the likeliest first, with
        their `probabilities`, `entropy` (B,) of the whole belief in bits, `lost` (B,), the probability that an agent is not
        within one place of its likeliest one, and `says_lost`, bool (B,): that is above .7, and was not at some step of the
        episode, or the likeliest place leapt just now to one that was unlikely before, if this was asked at each step. On
        streets places are states, and no leap counts. None of a policy that has no belief, and of an exported one."""
        if self._believed != self._steps and (columns := self._acting.belief(self._first_frame)):
            belief = dict(zip(("places", "probabilities", "entropy", "lost"), columns))
            goes_on = self._believed == self._steps - 1 and not self._streets
            belief["says_lost"] = self._lost.say(*columns[:2], columns[3], self._starts, goes_on)
            self._belief, self._believed = belief, self._steps
        return self._belief


@none_is_default
def evaluate(policy: _native.Agent | _native.ExportedPolicy | str | Act, *, traversals: Sequence[str] = (),
             controls: Sequence[str] = (), tasks: int = 2000, seed: int = 1, frames: int | str | None = None,
             max_steps: int = 0, max_detour: int | None = None, train: str | None = None, name: str = "policy",
             control_parameters: dict[str, dict[str, float]] | None = None, **options: Any) -> Scores:
    """Lets a policy perform numbered tasks, and returns its figures as policy_service --mode evaluate has them.

    policy: of load_policy(); a control's name ("shortest_path"); or a function of observations, as VectorEnv's, and
      episode starts, bool (B,), that returns actions (B,). `name` is the function's in the results.
    traversals: to walk on; `traversal` alone by default, which is the first one that the policy learned from, else
      summer.
    controls: evaluated on the same tasks; "shuffled" is the policy on shuffled frames, "all" means every one.
    tasks, seed: the same seed gives every policy the same tasks.
    frames, max_steps, max_detour: the route, as VectorEnv has it; a checkpoint's own by default. On streets there is no
      control "shuffled".
    train: the traversal whose features the controls' filters know, unless the policy is a checkpoint's own; by default
      the first one that the policy learned from. A checkpoint that walks on other streets than it learned on knows
      these by it.
    options: as VectorEnv's in process. A policy of load_policy() brings those of its training along: dataset, folder,
      frames, encoder. Other recordings are seen through its encoder, with what that learned in the training. Raises
      ValueError for a recording that differs from the one of its name, or has features of another kind.
    """
    if not isinstance(policy, (*_LOADED, str)) and not callable(policy):
        raise TypeError(f"policy must be of load_policy(), the name of a control or a function, is {policy!r}")
    for what, names in (("traversals", traversals), ("controls", controls)):
        if isinstance(names, str):
            raise TypeError(f"{what} must be a list of names, is {names!r}")
    count("tasks", tasks, 1)
    seed_of(seed)
    agent = policy if isinstance(policy, _LOADED) else None
    own = agent.name if agent else policy if isinstance(policy, str) else name
    learned = agent.data if agent else _native.TrainingData()
    if agent and not learned.traversals:
        if not any(name in ("data", "dataset") or name.startswith("synthetic_") for name in options):
            raise ValueError("the policy does not say what it learned from; give data=, or dataset=\"synthetic\"")
        warnings.warn("the policy does not say what it learned from, so the data are not checked", stacklevel=3)
    train = train or (learned.traversals or ["summer"])[0]
    every = "all" in controls
    if every:
        controls = ["shuffled", *_native.controls()]
    for control, values in (control_parameters or {}).items():
        if control not in (own, *controls):
            raise ValueError(f"control_parameters: '{control}' is not one of what is evaluated, "
                             + ", ".join((own, *controls)))
        for parameter, value in values.items():
            check_number(f"control_parameters: {parameter} of {control}", value)
    scores = Scores()
    shown = options.pop("traversal", (learned.traversals or ["summer"])[0])
    recordings = {each: _native.Recording(as_text({**options, "traversal": each}), learned)
                  for each in traversals or [shown]}

    def reference(control: str, recording: Any, route: Any) -> Any:
        if control == "oracle_filter":
            return recording.reference(route)
        if not control.endswith("_filter") and not (agent and control == own):
            return _native.Reference()
        if isinstance(agent, _native.Agent) and agent.learned_on(recording.streets):
            return agent.reference
        try:
            known = recordings.get(train) or _native.Recording(as_text({**options, "traversal": train}), learned)
        except ValueError as error:
            raise ValueError(f"train '{train}', whose features {control} knows: {error}") from None
        if known.streets.hash != recording.streets.hash:
            raise ValueError(f"traversal '{recording.name}': walks on other streets than train '{train}'")
        return known.reference(route)

    for label in [own, *(control for control in controls if control != own)]:
        for traversal, recording in recordings.items():
            if label == "shuffled" and recording.on_streets and every:
                continue
            own_route = agent and frames is None and not recording.on_streets
            route = route_of(f"{agent.first_frame}:{agent.first_frame + agent.frames}" if own_route else frames,
                             max_steps or agent.frames if own_route else max_steps, label == "shuffled", max_detour,
                             recording, traversal)
            which = own if label == "shuffled" else label
            if agent and which == own:
                elsewhere = (isinstance(agent, _native.Agent) and recording.on_streets
                             and not agent.learned_on(recording.streets))
                acting = _policy_on(agent, seed, recording.streets,
                                    reference(which, recording, route) if elsewhere else None)
            elif callable(policy) and which == own:
                acting = _native.function_policy(_columns(policy), recording.features, route.first_frame)
            else:
                acting = _native.control_policy(which, (control_parameters or {}).get(which, {}), route,
                                                reference(which, recording, route), recording)
            scores[label, recording.name] = _native.evaluate(acting, recording, route, tasks, seed)
    return scores


def _policy_on(policy: Any, seed: int, streets: Any, reference: Any = None) -> Any:
    if isinstance(policy, _native.Agent):
        return _native.agent_policy(policy, seed_of(seed), streets, reference or policy.reference)
    return _native.exported_policy(policy, seed_of(seed), streets)


def _columns(act: Act) -> Callable[[tuple[np.ndarray, ...]], np.ndarray]:
    def choose(columns: tuple[np.ndarray, ...]) -> np.ndarray:
        features, goal, previous_action, mask, _, _, flags, _ = columns
        actions = np.asarray(act({"features": features, "goal": goal, "previous_action": previous_action,
                                  "action_mask": mask}, (flags & 1) != 0))
        if actions.shape != goal.shape or actions.dtype.kind not in "iu" or actions.min() < 0 or actions.max() > 2:
            raise ValueError(f"the policy must return {len(goal)} whole numbers 0..2, one per agent")
        return actions.astype(np.uint8)

    return choose
