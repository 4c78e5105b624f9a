# SPDX-License-Identifier: Apache-2.0
"""Means and shares with the interval that holds the true value in 95 of 100 cases, and curves of them."""

import math
import statistics
from dataclasses import dataclass
from functools import lru_cache

Bounds = tuple[float, float]
SHARES: Bounds = (0, 1)
COUNTS: Bounds = (0, math.inf)
# Where the figures of a trial can lie; the others are counts.
BOUNDS = {"completed": SHARES, "spl": SHARES, "reward": (-1, 1), "excess": (1, math.inf)}


@dataclass(frozen=True)
class Estimate:
    mean: float = math.nan
    low: float = math.nan  # NaN: there is no interval
    high: float = math.nan
    n: int = 0  # values that it comes from


@lru_cache
def student_quantile(freedom: int) -> float:
    """Returns the 97.5 % quantile of Student's t distribution (Abramowitz and Stegun, 26.7.3 and 26.7.4)."""
    low, high = 0.0, math.pi / 2
    for _ in range(100):
        angle = (low + high) / 2
        term = math.cos(angle) if freedom % 2 else 1.0
        total = 0.0
        for k in range(1 + freedom % 2, freedom, 2):
            total += term
            term *= math.cos(angle) ** 2 * k / (k + 1)
        inside = math.sin(angle) * total
        if freedom % 2:
            inside = (inside + angle) * 2 / math.pi
        low, high = (angle, high) if inside < 0.95 else (low, angle)
    return math.sqrt(freedom) * math.tan((low + high) / 2)


def mean_of(values: list[float], bounds: Bounds = (-math.inf, math.inf)) -> Estimate:
    """Returns the mean of independent values, such as seeds; its interval is cut to the bounds of the figure. Values
    that are not finite are left out."""
    values = [value for value in values if math.isfinite(value)]
    n = len(values)
    mean = statistics.mean(values) if values else math.nan  # exact, so that equal values have no spread
    if n < 2:
        return Estimate(mean, n=n)
    reach = student_quantile(n - 1) * statistics.stdev(values, mean) / math.sqrt(n)
    return Estimate(mean, max(mean - reach, bounds[0]), min(mean + reach, bounds[1]), n)


def share_of(successes: float, trials: int) -> Estimate:
    """Returns a share of independent trials (Wilson, JASA 1927)."""
    if trials < 1:
        return Estimate()
    z = 1.959963984540054  # 97.5 % of the normal distribution
    share, scale = successes / trials, 1 + z * z / trials
    centre = share + z * z / (2 * trials)
    spread = z * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    return Estimate(share, max(0.0, (centre - spread) / scale), min(1.0, (centre + spread) / scale), trials)


def smoothed(values: list[float], weight: float) -> list[float]:
    """Smooths exponentially, as TensorBoard does, without a pull to zero at the beginning. `weight` is that of the
    past. Values that are not finite change nothing."""
    result, total, count = [], 0.0, 0.0
    for value in values:
        if math.isfinite(value):
            total = weight * total + (1 - weight) * value
            count = weight * count + (1 - weight)
        result.append(total / count if count > 0 else math.nan)
    return result


def fixed(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def text_of(estimate: Estimate, digits: int) -> str:
    """Returns "0.941 (0.931..0.955)", the figure alone where there is no interval, "-" where there is no figure."""
    middle = fixed(estimate.mean, digits)
    if not math.isfinite(estimate.low) or not math.isfinite(estimate.high):
        return middle
    return f"{middle} ({fixed(estimate.low, digits)}..{fixed(estimate.high, digits)})"


def percent(estimate: Estimate) -> str:
    hundredfold = Estimate(100 * estimate.mean, 100 * estimate.low, 100 * estimate.high, estimate.n)
    return text_of(hundredfold, 1) + " %"
