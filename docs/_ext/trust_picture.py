"""Draw the picture of trust (see validation/trust.py) and the speed of releases, and write their text and tables."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

COLORS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#8c6bb1",
    "#7f7f7f",
    "#a6761d",
    "#17becf",
)
MARKERS = {"measured": "o", "published": "s", "law": "^", "exact": "D"}
INK = {"": ("#24292f", "#c2471f"), "_dark": ("#d6dbe1", "#ff8a65")}
"""Colours of text and lines, and of the model's lines, by ending of the file's name."""

AXES = {"time of searches": "s", "drag": "coefficients, Pa", "concentration fluctuation": "c'/C, or ratios"}
LEAD = """\
Each point: a measured value (x) and ours (y), hollow (○) if the case misses one of its bounds. Black: agreement; red:
our bias, the mean factor δ. Dashed: ±2 σ, of the experiments in black and ours in red.
"""
ABOUT = """\
Circles: measured; squares: published; triangles: laws; diamonds: numerical benchmarks. Last panel: time of a step.
"""
HOW = """\
As in the validation guide of FDS ([McGrattan & Toman 2011](https://doi.org/10.1088/0026-1394/48/3/011)): δ is the mean
factor by which we are too high, σ the relative standard deviation that remains once that of the experiments is taken
away. All cases count alike, however many points they have; a curve shows at most {points} of its points. Velocities
change sign and shares end at 0 and 1, so these two count by differences: of the largest measured speed, and of shares.
Velocities, mean concentrations and temperatures are over the largest measured value of the case. Where a source states
no uncertainty, it is that of the guide: 8 % for velocity and concentration, 7 % for temperature, else 0, and all
scatter counts as ours. Temperature has no measured case yet: heat transfer and the flow rate of warm plumes stand in;
drag has numerical benchmarks. Of gas maps only upper bounds are published: errors over those of a simpler method.
Equations: `validation/trust.py`.
"""
SPEED = """\
Time of a step of flow and gas per cell on {cores} cores, the least of several turns on a shared machine, beside the
memory bandwidth: {figures}. `python docs/validation/make.py --speed` adds a release.
"""


def write(folder: Path, cases: Mapping[str, Any], results: Mapping[str, Any]) -> str:
    """Draw plots/trust.svg for light and dark pages, and return the text of the page's first screen."""
    from taichi_plume.validation import trust

    collected = trust.collected(cases, results)
    speeds = json.loads((folder / "speed.json").read_text(encoding="utf-8"))
    for ending in INK:
        _draw(collected, speeds, folder / "plots" / f"trust{ending}.svg", ending)
    missed = {group.case for groups in collected.values() for group in groups if not group.met}
    alt = f"computed beside measured values of eight quantities; hollow, as not all is met: {', '.join(sorted(missed))}"
    images = (
        f"```{{image}} validation/plots/trust{ending}.svg\n:alt: {alt}\n:class: only-{page}\n```\n"
        for ending, page in zip(INK, ("light", "dark"), strict=True)
    )
    how = HOW.format(points=trust.POINTS)
    return "\n".join(
        [LEAD, *images, ABOUT, _table(collected), how, _speeds(speeds), _absent(cases, results, collected)]
    )


def _statistics(quantity: Any, groups: Sequence[Any]) -> tuple[Any, list[str]]:
    """Statistics of a quantity, and the texts of bias and deviations; a dash where too few points decide."""
    from taichi_plume.validation import trust

    differences = trust.SCALES[quantity].differences
    found = trust.statistics(groups, differences)
    texts = [f"{found.bias:{'+' * differences}.2f}", f"{found.model:.2f}", f"{found.experiments:.2f}"]
    return found, texts if np.isfinite(found.bias) else ["–"] * 3


def _table(collected: Mapping[Any, Sequence[Any]]) -> str:
    """Table of the statistics by quantity, and of the cases in each."""
    rows = ["| quantity | cases | points | δ | σ, model | σ, experiments |", "|---|---|---|---|---|---|"]
    for quantity, groups in collected.items():
        names = ", ".join(f"`{group.case}`" + ("" if group.met else " ○") for group in groups)
        if groups[0].bound:
            cells = (str(sum(len(group.measured) for group in groups)), _kept(groups), "", "")
        else:
            found, texts = _statistics(quantity, groups)
            cells = (str(found.points), *texts)
        rows.append(f"| {quantity} | {len(groups)}: {names} | {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def _kept(groups: Sequence[Any]) -> str:
    kept = sum(int((group.computed <= group.measured).sum()) for group in groups)
    return f"{kept} of {sum(len(group.measured) for group in groups)} as claimed"


def _absent(
    cases: Mapping[str, Any], results: Mapping[str, Any], collected: Mapping[Any, Sequence[Any]]
) -> str:
    """Measured and published cases that are not in the picture, with the reason."""
    shown = {group.case for groups in collected.values() for group in groups}
    reasons = {
        name: case.compared
        if isinstance(case.compared, str)
        else "no finite value"
        if name in results
        else "not run"
        for name, case in cases.items()
        if case.evidence in ("measured", "published") and name not in shown
    }
    rows = [f"- `{name}`: {reason}" for name, reason in reasons.items()]
    return "\n".join(["<details><summary>Not in the picture, and why</summary>\n", *rows, "\n</details>\n"])


def _speeds(speeds: Sequence[Mapping[str, Any]]) -> str:
    figures = "; ".join(
        f"{one['version']} of {one['date']} "
        + ", ".join(
            f"`{name}` {ns:.0f} ns (the time of {ns * one['bandwidth'] / 1e3:.1f} kB)"
            for name, ns in one["ns"].items()
        )
        + f" at {one['bandwidth']:.0f} GB/s"
        for one in speeds
    )
    return SPEED.format(cores=speeds[-1]["cores"], figures=figures)


# ---------------------------------------------------------------- drawing


def _draw(
    collected: Mapping[Any, Sequence[Any]], speeds: Sequence[Mapping[str, Any]], path: Path, ending: str
) -> None:
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    ink, model = INK[ending]
    colored = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color", "grid.color")
    look = dict.fromkeys(colored, ink) | {"svg.hashsalt": "trust", "font.size": 7.5, "axes.linewidth": 0.6}
    look |= {"axes.facecolor": "none", "figure.facecolor": "none", "legend.frameon": False}
    with rc_context(look):
        rows = len(collected) // 3 + 1
        figure = Figure(figsize=(8.4, 2.0 * rows), layout="constrained")
        axes = list(figure.subplots(rows, 3).flat)
        for axis, (quantity, groups) in zip(axes, collected.items(), strict=False):
            axis.set_title(quantity, fontsize=9, fontweight="bold", loc="left")
            axis.grid(alpha=0.15, linewidth=0.5)
            (_bounds if groups[0].bound else _scatter)(axis, quantity, groups, ink, model)
        _bars(axes[len(collected)], speeds)
        for axis in axes[len(collected) + 1 :]:
            axis.remove()
        figure.savefig(path, metadata={"Date": None})


def _points(axis: Any, groups: Sequence[Any], x: Any = None) -> None:
    for n, group in enumerate(groups):
        color = COLORS[n % len(COLORS)]
        axis.scatter(
            group.measured if x is None else x(n, group),
            group.computed,
            s=13,
            marker=MARKERS[group.evidence],
            facecolors=color if group.met else "none",
            edgecolors=color,
            linewidths=0.8,
            label=group.case,
            zorder=3,
        )


def _scatter(axis: Any, quantity: Any, groups: Sequence[Any], ink: str, model: str) -> None:
    from matplotlib.ticker import LogLocator

    from taichi_plume.validation import trust

    scale = trust.SCALES[quantity]
    _points(axis, groups)
    values = np.concatenate([part for group in groups for part in (group.measured, group.computed)])
    if scale.differences:
        low, high = min(values.min(), 0.0), max(values.max(), 1.0)
        ends = np.array([low - 0.05 * (high - low), high + 0.05 * (high - low)])
    else:
        ends = np.array([values.min() / 1.3, values.max() * 1.3])
        axis.set(xscale="log", yscale="log")
    found, texts = _statistics(quantity, groups)
    grid = np.linspace(*ends, 2) if scale.differences else np.geomspace(*ends, 2)

    def line(bias: float, off: float, color: str, style: str) -> None:
        y = grid + bias + off if scale.differences else grid * bias * np.exp(off)
        axis.plot(grid, y, style, color=color, linewidth=0.9, scalex=False, scaley=False)

    none = 0.0 if scale.differences else 1.0
    line(none, 0.0, ink, "-")
    if np.isfinite(found.bias):
        line(found.bias, 0.0, model, "-")
        for sign in (-2.0, 2.0):
            line(none, sign * found.experiments, ink, "--")
            line(found.bias, sign * found.model, model, "--")
    if not scale.differences:
        for one in (axis.xaxis, axis.yaxis):
            one.set_major_locator(LogLocator(subs=(1.0,) if ends[1] > 30.0 * ends[0] else (1.0, 2.0, 5.0)))
            one.set_major_formatter("{x:g}")
            one.set_minor_formatter("")
    unit = " over largest" if scale.relative else f" [{AXES[quantity]}]" if quantity in AXES else ""
    axis.set(xlim=ends, ylim=ends, xlabel=f"measured{unit}", ylabel="computed")
    text = "δ {}\nσ {}\nexp. {}".format(*texts)
    axis.text(0.98, 0.03, text, transform=axis.transAxes, ha="right", va="bottom")
    axis.legend(fontsize=6, loc="upper left", handletextpad=0.1, borderpad=0.1, labelspacing=0.2)


def _bounds(axis: Any, quantity: Any, groups: Sequence[Any], ink: str, model: str) -> None:
    """Draw values over their published upper bounds, case by case."""

    def spread(n: int, group: Any) -> np.ndarray:
        return n + np.linspace(-0.35, 0.35, len(group.computed))

    _points(axis, groups, spread)
    axis.axhline(1.0, color=ink, linewidth=0.9)
    axis.set_xticks(range(len(groups)), [group.case for group in groups])
    axis.set(ylabel="ours over published bound", xlim=(-0.5, len(groups) - 0.5))
    axis.text(1.0, 1.02, _kept(groups), transform=axis.transAxes, ha="right", va="bottom", fontsize=6.5)


def _bars(axis: Any, speeds: Sequence[Mapping[str, Any]]) -> None:
    """Draw the time of a step per cell of each release."""
    axis.set_title("speed of a step, by release", fontsize=9, fontweight="bold", loc="left")
    names = list(speeds[-1]["ns"])
    width = 0.8 / len(names)
    for k, (name, color) in enumerate(zip(names, COLORS, strict=False)):
        known = [(n, one["ns"][name]) for n, one in enumerate(speeds) if name in one["ns"]]
        place = [n + (k - 0.5 * (len(names) - 1)) * width for n, _ in known]
        axis.bar(place, [ns for _, ns in known], width, color=color, label=name)
        for x, (_, ns) in zip(place, known, strict=True):
            axis.text(x, ns, f"{ns:.0f}", ha="center", va="bottom", fontsize=6.5)
    axis.set_xticks(range(len(speeds)), [f"{one['version']}\n{one['date']}" for one in speeds])
    axis.set(ylabel="ns per cell and step")
    axis.margins(y=0.25)
    axis.legend(fontsize=6, loc="upper right")
