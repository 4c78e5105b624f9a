# SPDX-License-Identifier: Apache-2.0
"""Keyword arguments as the services' options."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable
from numbers import Number
from pathlib import Path
from typing import Any

import numpy as np

try:
    from . import _native
except ImportError as error:
    if "cannot open shared object file" in str(error):
        raise ImportError(f"citylearn's module needs a package of the system: {error}; the command `citylearn` of the "
                          "same environment says which") from None
    _there = ", ".join(path.name for path in Path(__file__).parent.glob("_native.*")) or "none"
    raise ImportError(f"citylearn's module does not load in {sys.implementation.cache_tag} ({sys.executable}); there "
                      f"is {_there}; build it for this Python, or take another: {error}") from None

for _array in _native.sample_arrays():  # pybind11 before 2.12 reads the layout of NumPy 1
    if _array.strides != np.empty(_array.shape, _array.dtype).strides:
        raise ImportError(f"citylearn's arrays have wrong strides under NumPy {np.__version__}; install an older "
                          "NumPy, or build citylearn with a newer pybind11")

DEFAULT_FRAMES = 128


def none_is_default(function: Callable[..., Any]) -> Callable[..., Any]:
    """Leaves out keyword arguments that are None, such as those of an argparse.Namespace that were not given."""

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        return function(*arguments, **{name: value for name, value in named.items() if value is not None})

    return call


def as_text(options: dict[str, Any]) -> dict[str, str]:
    """Returns keyword arguments as the texts of a command line; None leaves an option out. Raises TypeError."""

    def text(name: str, value: Any) -> str:
        if isinstance(value, (list, tuple)):
            value = ",".join(text(name, one) for one in value)
        if not isinstance(value, (str, os.PathLike, Number, np.bool_)):
            raise TypeError(f"{name} must be a text, a number or a list of them, is {value!r}")
        value = str(int(value) if isinstance(value, (bool, np.bool_)) else value)
        if not value:  # would take the next option for its value
            raise ValueError(f"{name} is empty; leave it out")
        return value

    return {name: text(name, value) for name, value in options.items() if value is not None}


def count(name: str, value: Any, least: int, most: int = 2**30) -> int:
    """Returns a whole number of this range. Raises TypeError or ValueError."""
    try:
        number = value.__index__()
        if isinstance(value, bool):
            raise TypeError
    except (AttributeError, TypeError):
        raise TypeError(f"{name} must be a whole number, is {value!r}") from None
    if not least <= number <= most:
        raise ValueError(f"{name} must be {least}..{most}, is {number}")
    return number


def check_number(name: str, value: Any, unit: str = "") -> None:
    """Raises TypeError for what is no number, of `unit` (" of seconds") if that is given."""
    if isinstance(value, str) or not hasattr(value, "__float__"):
        raise TypeError(f"{name} must be a number{unit}, is {value!r}")


def seconds(name: str, value: Any) -> float:
    """Returns a time to wait. Raises TypeError or ValueError."""
    check_number(name, value, " of seconds")
    if not float(value) > 0:
        raise ValueError(f"{name} must be more than 0 seconds, is {value}")
    return float(value)


def check_process(owner: int, what: str) -> None:
    """Raises RuntimeError in a process that was forked from `owner`."""
    if os.getpid() != owner:
        raise RuntimeError(f"{what} belongs to process {owner}, from which this one was forked; make a new one here")


def seed_of(seed: Any) -> int:
    """Returns a seed. Raises TypeError or ValueError."""
    return count("seed", seed, 0, 2**64 - 1)


def route_of(frames: int | str | None, max_steps: int, shuffle: bool, max_detour: int | None, on: Any,
             name: str) -> _native.Route:
    """Returns the route that `frames` names, "FIRST:END" or a number, on a recording or environments; by default the
    whole of streets, with a limit of three times the fewest steps."""
    available = on.frames
    first, end = 0, available if on.on_streets else min(DEFAULT_FRAMES, available)
    if isinstance(frames, str):
        try:
            first, end = (int(part) if part.strip() else least for part, least in
                          zip(frames.split(":"), (0, available), strict=True))
        except ValueError:
            raise ValueError(f"frames: '{frames}' is not FIRST:END, of which one may be left out") from None
    elif frames is not None:
        end = count("frames", frames, 2)
    if not (0 <= first and first + 2 <= end <= available):
        raise ValueError(f"frames: {first}:{end} must be two frames or more of the {available} of traversal '{name}'")
    if shuffle not in (False, True):
        raise TypeError(f"shuffle must be True or False, is {shuffle!r}")
    detour = 3 * on.on_streets if max_detour is None else count("max_detour", max_detour, 0)
    return _native.Route(first, end - first, count("max_steps", max_steps, 0) or end - first, bool(shuffle), detour)
