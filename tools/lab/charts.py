# SPDX-License-Identifier: Apache-2.0
"""Charts as SVG and PNG: the same data always give the same bytes."""

import itertools
import math
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib
from matplotlib import ticker
from matplotlib.figure import Figure

# Okabe and Ito's colours, which most colour-blind people can tell apart, in shades with contrast on white.
COLOURS = ["#0b84c8", "#d55e00", "#009e73", "#b8860b", "#c0569b", "#7a6ff0", "#d0453b", "#5c9a1b"]
DASHES = ["-", (0, (4, 2)), (0, (1, 2))]
PIXELS_PER_INCH = 96

matplotlib.rcParams.update({
    "svg.hashsalt": "citylearn", "svg.fonttype": "none", "font.size": 9, "axes.titlesize": 11,
    "axes.titleweight": "semibold", "axes.titlelocation": "left", "axes.grid": True, "grid.alpha": 0.3,
    "axes.spines.top": False, "axes.spines.right": False, "axes.axisbelow": True, "legend.frameon": False})


@dataclass
class Line:
    """A line, with a band around it where `low` and `high` are given (as long as `y`)."""
    label: str
    x: list[float] = field(default_factory=list)
    y: list[float] = field(default_factory=list)
    low: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)
    dashed: bool = False  # a yardstick rather than a measurement
    dots: bool = False  # points without a line between them

    def add(self, x: float, y: float, *band: float) -> None:
        """Adds a point, with the low and the high end of its band if there is one."""
        self.x.append(x)
        self.y.append(y)
        for values, value in zip((self.low, self.high), band):
            values.append(value)


@dataclass
class Chart:
    title: str
    x_label: str
    y_label: str
    lines: list[Line] = field(default_factory=list)
    x_limits: tuple[float, float] | None = None  # None: as the values need
    y_limits: tuple[float, float] | None = None
    x_logarithmic: bool = False
    width: float = 420  # of the plot area, in pixels
    height: float = 420


@dataclass
class Bar:
    value: float
    low: float
    high: float


@dataclass
class BarChart:
    """Groups of bars side by side, each bar with an interval (NaN: none)."""
    title: str
    unit: str
    names: list[str]  # of the bars in each group, for the legend
    groups: dict[str, list[Bar]] = field(default_factory=dict)


def round_step(span: float, wanted: int) -> float:
    """Returns 1, 2 or 5 times a power of ten, so that about `wanted` steps make the span."""
    rough = span / wanted
    power = 10.0 ** math.floor(math.log10(rough))
    return power * next((factor for factor in (1, 2, 5) if rough / power <= factor), 10)


def limits_around(values: list[float], from_zero: bool = False) -> tuple[float, float]:
    """Returns round ends of an axis that holds all finite values; (0, 1) when there are none."""
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return 0, 1
    low, high = min([0.0, *finite] if from_zero else finite), max(finite)
    if high <= low:
        high = low + 1
    step = round_step(high - low, 5) / 2
    return math.floor(low / step + 1e-9) * step, math.ceil(high / step - 1e-9) * step


def _new_plot(width: float, height: float, title: str):
    figure = Figure(figsize=(width / PIXELS_PER_INCH, height / PIXELS_PER_INCH))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_title(title)
    return figure, axes


def _legend(axes) -> None:
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1), borderaxespad=0)


def draw_chart(chart: Chart) -> Figure:
    """Draws lines and dots; values that are not finite are left out."""
    figure, axes = _new_plot(chart.width, chart.height, chart.title)
    styles = itertools.product(DASHES, COLOURS)
    for line, (dashes, colour) in zip(chart.lines, itertools.cycle(styles)):
        points = [point for point in zip(line.x, line.y) if all(map(math.isfinite, point))]
        band = [point for point in zip(line.x, line.low, line.high) if all(map(math.isfinite, point))]
        x, y = [point[0] for point in points], [point[1] for point in points]
        if band:
            axes.fill_between(*zip(*band), color=colour, alpha=0.18, linewidth=0)
        single = line.dots or len(points) == 1
        style = "none" if single else DASHES[1] if line.dashed else dashes
        axes.plot(x, y, color=colour, label=line.label, linestyle=style, marker="o" if single else None, clip_on=False)
    axes.set_xlabel(chart.x_label)
    axes.set_ylabel(chart.y_label)
    if chart.x_logarithmic:
        axes.set_xscale("log")
    if chart.x_limits:
        axes.set_xlim(chart.x_limits)
    if chart.x_logarithmic:
        low, high = axes.get_xlim()
        axes.xaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(ticker.NullFormatter())
    if chart.y_limits:
        axes.set_ylim(chart.y_limits)
    _legend(axes)
    return figure


def draw_bars(chart: BarChart) -> Figure:
    """Draws bars from 0 to 1; those without a value are left out."""
    count = len(chart.names)
    figure, axes = _new_plot(max(420, 28 * len(chart.groups) * (count + 1)), 320, chart.title)
    for i, (name, colour) in enumerate(zip(chart.names, itertools.cycle(COLOURS))):
        bars = [group[i] for group in chart.groups.values()]
        at = [group + (i + 0.5 - count / 2) / (count + 1) for group in range(len(bars))]
        axes.bar(at, [bar.value for bar in bars], 0.86 / (count + 1), color=colour, label=name)
        whiskers = [(x, bar.low, bar.high) for x, bar in zip(at, bars) if math.isfinite(bar.high)]
        axes.vlines(*(zip(*whiskers) if whiskers else ([], [], [])), color="#1f2328")
    axes.set_xticks(range(len(chart.groups)), list(chart.groups))
    axes.grid(visible=False, axis="x")
    axes.set_ylabel(chart.unit)
    axes.set_ylim(0, 1)
    _legend(axes)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Writes the figure as the file `path` whose suffix, .svg or .png, names the format."""
    metadata = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    figure.savefig(path, bbox_inches="tight", pad_inches=0.1, dpi=2 * PIXELS_PER_INCH, metadata=metadata)
