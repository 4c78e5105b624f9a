# SPDX-License-Identifier: Apache-2.0
"""A learner in Python for actors of policy_service."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._options import _native, as_text, check_number, check_process, count, none_is_default, seconds, seed_of


@dataclass(frozen=True, eq=False, repr=False)
class Batch:
    """What B agents saw and did over L steps, as arrays whose first dimensions are (L, B). Most lie in memory of the
    C++ learner, which lives as long as they do; they may be written into. An agent's steps follow one another; an
    episode may begin and end anywhere among them.

    Seen, as VectorEnv has it:
      features         float32 (L, B, D)  of the frame that the agent saw, with the noise that actors add for training
      goal             int32 (L, B)       place to reach, 0..N-1
      position         int32 (L, B)       place stood at
      previous_action  uint8 (L, B)       0..2, or 3 at the start of an episode
      action_mask      int8 (L, B, 3)     1 where the action stays on the route
      first            uint8 (L, B)       1 where an episode begins: the state before it is wiped
      next             dict               the same of the observation after the last step, first dimension (B,)
    Recurrent state:
      state            float32 (B, S)     of the network before the first step, as the actor had it
    Done, by the parameters that the actor had:
      action           uint8 (L, B)       0..2
      log_probability  float32 (L, B)     of the action
      value            float32 (L, B)     the network's estimate for the observation
      reward           float32 (L, B)     of the action, as trainer_step_cost says
      ended            uint8 (L, B)       by the action: 0 goes on, 1 at the goal, 2 at the step limit
      final_value      float32 (L, B)     where `ended` is 2: value of what would have been seen next
      last_value       float32 (B,)       value of `next`
    """

    features: np.ndarray
    goal: np.ndarray
    position: np.ndarray
    previous_action: np.ndarray
    action_mask: np.ndarray
    first: np.ndarray
    next: dict[str, np.ndarray]
    state: np.ndarray
    action: np.ndarray
    log_probability: np.ndarray
    value: np.ndarray
    reward: np.ndarray
    ended: np.ndarray
    final_value: np.ndarray
    last_value: np.ndarray
    _rollout: _native.Rollout

    def advantages(self, discount: float, decay: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns generalised advantage estimates (Schulman et al., 2016) of `reward` and `value`, and the values'
        targets, advantage + value: both float32 (L, B). `decay` is the paper's lambda."""
        for name, factor in (("discount", discount), ("decay", decay)):
            check_number(name, factor)
            if not 0 <= factor <= 1:
                raise ValueError(f"{name} must be 0..1, is {factor}")
        return self._rollout.advantages(discount, decay)


class Trajectories:
    """The learner of a session, to which actors (policy_service --role actor) send what their agents saw and did.

    Iterating waits for batches; publish() answers one with the parameters that actors are to act with. Actors, C++
    programs that know nothing of Python, may come late, die and be replaced. They need env_services to drive.

        with citylearn.Trajectories(session="default", agent="baseline", output="runs/first") as source:
            for batch in source:
                source.publish(learn(batch), entropy=1.0)
                if source.progress["spl"] > 0.9:
                    break

    Leaving the `with` block normally ends training: the last checkpoint is written and the actors are dismissed. After
    an exception they wait, and a learner with resume=True goes on.

    Attributes: agent, the network's name; values, its parameters by name; features (D), frames (N) and state_size (S).
    """

    @none_is_default
    def __init__(self, *, agent: str = "features", traversal: str = "summer", frames: int | str | None = None,
                 seed: int = 1, output: Any = None, initial: Any = None, wait: float = 30, **options: Any):
        """Waits until an env_service on `traversal` has told what it is about.

        agent: the network that actors act with; policy_service --list names them. `baseline` and `features` are a
          linear layer and an LSTM, easily written in another library (examples/torch_actors.py).
        frames: the route, a number of frames from the first on or "FIRST:END"; the first 128 by default.
        seed: of the first parameters and of what actors draw.
        output: folder for checkpoints/ (load_policy reads them), metrics.csv, manifest.json and tensorboard/.
        initial: checkpoint (.clk) whose agent's parameters come first, in place of drawn ones.
        wait: seconds without an env_service, or without a batch, until TimeoutError.
        options: those of policy_service --role learner, with _ for -: steps (without end unless given), stop_when,
          checkpoint_every, evaluate, evaluate_every, resume, max_steps, max_lag; the network's and the trainer's
          parameters, such as baseline_cells and trainer_noise_frame; those of every service (session, middleware,
          domain, interface, peers ...). L is trainer_sequence, and B is trainer_agents x trainer_segment / L.
        Raises TypeError for an unknown option, ValueError for a wrong one, FileNotFoundError and TimeoutError.
        """
        self._learner: _native.Learner | None = None
        self._process = os.getpid()
        wait = seconds("wait", wait)
        if frames is not None and not isinstance(frames, str):
            frames = f"0:{count('frames', frames, 2)}"
        if initial is not None:
            with open(initial, "rb"):  # Python's own errors for what cannot be opened
                pass
        given = {"agent": agent, "train": traversal, "frames": frames, "seed": seed_of(seed), "output": output,
                 "initial": initial, "wait": wait, **options}
        self._learner = _native.Learner(as_text(given))
        network = self._learner.network
        self.agent: str = network.agent
        self.features: int = network.features
        self.frames: int = network.frames
        self.state_size: int = network.state_size
        self.values: dict[str, float] = network.values
        self._tensors = {tensor.name: tensor for tensor in network.tensors}
        self._pending = False  # a batch is to be answered

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """The network's parameters that actors have, by the names that checkpoints and exported safetensors give them:
        float32 (rows, columns), copies."""
        flat = self._open().parameters
        return {name: flat[tensor.offset:tensor.offset + tensor.rows * tensor.cols].reshape(
            (tensor.rows, tensor.cols), order="F") for name, tensor in self._tensors.items()}

    @property
    def progress(self) -> dict[str, Any]:
        """How far training had come at the last batch: updates, steps, episodes, lesson, and over the last 100 training
        episodes the means reward, spl (0..1) and episode_length, nan before the first."""
        return self._open().progress

    @property
    def actors(self) -> int:
        """The number of actors heard lately."""
        return self._open().actors

    def __iter__(self) -> Iterator[Batch]:
        return self

    def __next__(self) -> Batch:
        """Waits for the next batch. Without publish() after the last one the parameters stay as they are. Ends when
        `steps` are learned from or `stop_when` is reached. Raises TimeoutError; waiting may then go on."""
        learner = self._open()
        self._pending = False
        rollout = learner.next()
        if rollout is None:
            raise StopIteration
        self._pending = True
        return Batch(**rollout.arrays(), _rollout=rollout)

    def publish(self, parameters: Mapping[str, Any], **figures: float) -> None:
        """Sends the actors new parameters, all of the names and shapes of `parameters`; arrays or torch's tensors.

        figures: of the update, for metrics.csv and the dashboard: policy_loss, value_loss, entropy, approx_kl,
          clip_fraction, gradient_norm, learning_rate.
        Raises ValueError naming a parameter that is missing, unknown, of another shape or not finite, TypeError for one
        that is no number.
        """
        learner = self._open()
        if not self._pending:
            raise RuntimeError("publish() answers a batch; take the next one first")
        if not isinstance(parameters, Mapping):
            raise TypeError(f"parameters must be a dictionary of arrays by name, is {type(parameters).__name__}")
        for name, figure in figures.items():
            check_number(f"figure '{name}'", figure)
        flat = np.empty(sum(tensor.rows * tensor.cols for tensor in self._tensors.values()), np.float32)
        for name in parameters.keys() - self._tensors.keys():
            raise ValueError(f"network '{self.agent}' has no parameter '{name}'; it has {', '.join(self._tensors)}")
        for name, tensor in self._tensors.items():
            if name not in parameters:
                raise ValueError(f"parameter '{name}' of network '{self.agent}' is missing")
            values = parameters[name]
            values = np.asarray(values.detach().cpu() if hasattr(values, "detach") else values)
            if values.dtype.kind not in "fiu":
                raise TypeError(f"parameter '{name}' is {values.dtype}, must be float32")
            shape = (tensor.rows, tensor.cols)
            if values.shape != shape and not (tensor.cols == 1 and values.shape == shape[:1]):
                raise ValueError(f"parameter '{name}' has shape {values.shape}, must have {shape}")
            with np.errstate(over="ignore"):
                values = values.astype(np.float32)
            if not np.isfinite(values).all():
                raise ValueError(f"parameter '{name}' has numbers that are not finite")
            flat[tensor.offset:tensor.offset + values.size] = values.ravel(order="F")
        learner.publish(flat, {name: float(figure) for name, figure in figures.items()})
        self._pending = False

    def close(self) -> None:
        """Ends training: writes the last checkpoint to `output` and dismisses the actors."""
        self._end(dismiss=True)

    def __enter__(self) -> Trajectories:
        return self

    def __exit__(self, kind: Any, *_: Any) -> None:
        self._end(dismiss=kind is None)

    def _end(self, dismiss: bool) -> None:
        if self._learner is not None:
            learner, self._learner = self._learner, None
            if os.getpid() == self._process:
                learner.end(dismiss)

    def _open(self) -> _native.Learner:
        if self._learner is None:
            raise RuntimeError("the learner is closed; make a new one")
        check_process(self._process, "the learner")
        return self._learner
