"""Figures of a parameter study's page: results along axes and over pairs of axes, Sobol indices, grid refinement."""

from collections.abc import Hashable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.report import theme
from taichi_plume.studies.columns import is_number
from taichi_plume.studies.estimates import Points, Quantity
from taichi_plume.studies.indices import Index
from taichi_plume.studies.intervals import Estimate
from taichi_plume.studies.messages import Row, Value

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TALL = 2.5  # inches
MOST_LINES = 6  # lines in a panel
MOST_PANELS = 4
MOST_VALUES = 15  # values of an axis plotted with intervals; axes with more show dots and a running mean
MOST_DOTS = 3000
WINDOW = 0.15  # window of the running mean as a fraction of the axis

Estimates = Mapping[Hashable, Estimate]
Names = Sequence[Value | None]


def values_of(points: Points, axis: str) -> list[Any]:
    """Return the distinct values of a study's axis (or of "group", the robot groups); numbers are sorted."""
    values = list(dict.fromkeys(points.table[axis].dropna()))
    return sorted(values) if is_number(points.plan.table, axis) else values


def named(points: Points) -> list[str]:
    """Return the axes that have several non-numeric values; "group" is the first if there are several robot groups."""
    axes = [axis for axis in points.axes if not is_number(points.plan.table, axis)]
    groups = ["group"] if "group" in points.table else []
    return [axis for axis in (*groups, *axes) if len(values_of(points, axis)) > 1]


def numeric(points: Points) -> list[str]:
    """Return the names of the study's axes that have several numeric values."""
    return [
        axis
        for axis in points.axes
        if is_number(points.plan.table, axis) and len(values_of(points, axis)) > 1
    ]


def label(points: Points, axis: str) -> str:
    """Return the label of a study's axis for plots: its shortened name, and its unit in brackets if there is one."""
    unit = next((column.unit for column in points.plan.axes if column.name == axis), "")
    return theme.short(axis) + (f" [{unit}]" if unit not in ("", "1") else "")


def logarithmic(points: Points, axis: str) -> bool:
    """Return whether the study's file gives an axis logarithmic spacing and all values are positive."""
    found = (points.plan.about["study"].get("axes") or {}).get(axis)
    return isinstance(found, dict) and found.get("spacing") == "log" and min(values_of(points, axis)) > 0


def _scaled(quantity: Quantity, estimate: Estimate) -> list[float]:
    """Return mean, lower and upper end of an estimate with its interval; in per cent if the quantity is a fraction."""
    return [(100.0 if quantity.share else 1.0) * value for value in estimate[:3]]


# ---------------------------------------------------------------- along one axis


def along(points: Points, axis: str, by: str | None, quantities: Sequence[Quantity]) -> bytes:
    """Return a PNG of quantities over a numeric axis, a line per value of the axis `by`, MOST_LINES per panel."""
    lines = values_of(points, by) if by else [None]
    parts = [lines[n : n + MOST_LINES] for n in range(0, len(lines), MOST_LINES)][:MOST_PANELS]
    draw = _means if len(values_of(points, axis)) <= MOST_VALUES else _running
    keys = [axis, *([by] if by else [])]
    found = {q.name: points.estimated(q, keys) if draw is _means else {} for q in quantities}

    legend = theme.short(by) if by and len(parts) == 1 else ""
    with _panels(len(parts) * len(quantities), len(quantities), below=0.45 if legend else 0.0) as plot:
        for n, axes in enumerate(plot):
            part, quantity = parts[n // len(quantities)], quantities[n % len(quantities)]
            draw(axes, points, axis, by, part, quantity, found[quantity.name])
            _label_numeric(axes, points, axis, quantity)
            if n % len(quantities) == 0 and by and len(parts) > 1:
                axes.legend(loc="best", title=theme.short(by), title_fontsize=8, handlelength=1.2)
        if legend:
            handles = plot[0].get_legend_handles_labels()
            how = {"title_fontsize": 8, "alignment": "left", "handlelength": 1.2}
            plot.figure.legend(*handles, loc="lower left", ncols=3, title=f"{legend}:", **how)
    return plot.png


def _label_numeric(axes: "Axes", points: Points, axis: str, quantity: Quantity) -> None:
    """Set labels and scales of a panel that shows a quantity over a numeric axis."""
    axes.set(xlabel=label(points, axis), title=quantity.heading)
    if logarithmic(points, axis):
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("")
    if quantity.share:
        axes.set_ylim(-3, 103)


def of_axis(points: Points, axis: str, by: str | None, quantity: Quantity, place: theme.Place) -> "Figure":
    """Return a figure of a quantity over an axis of a study, as on its page: means with intervals.

    by: axis with a line per value, of a numeric `axis`. place: axes to draw into, or size of the figure.
    """
    small = theme.WIDE / 2, 1.2 * TALL
    with theme.styled({"text.parse_math": False}) if place.ax is None else nullcontext():
        made = None if place.ax is not None else theme.figure(*(place.figsize or small), theme.DPI)
        axes = made.subplots() if made is not None else place.ax
        assert axes is not None
        theme.plain(axes)
        if axis not in numeric(points):
            names = values_of(points, axis)
            _intervals(axes, quantity, names, points.estimated(quantity, [axis]), True)
        else:
            are_few = len(values_of(points, axis)) <= MOST_VALUES
            found = points.estimated(quantity, [axis, *([by] if by else [])]) if are_few else {}
            draw = _means if are_few else _running
            draw(axes, points, axis, by, values_of(points, by) if by else [None], quantity, found)
            _label_numeric(axes, points, axis, quantity)
            if by:
                theme.verbatim(axes.legend(loc="best", title=theme.short(by)).get_texts())
        if made is not None:
            made.set_layout_engine("constrained")
        return made or theme.figure_around(axes)


def _means(
    axes: "Axes",
    points: Points,
    axis: str,
    by: str | None,
    part: Names,
    quantity: Quantity,
    found: Estimates,
) -> None:
    """Draw a line through the means of a quantity along an axis, with intervals; a line per value of `by` in `part`."""
    places = values_of(points, axis)
    log = logarithmic(points, axis)
    apart = 0.006 * (np.log(max(places) / min(places)) if log else max(places) - min(places))
    for n, name in enumerate(part):
        keys = [(place, name) if by else place for place in places]
        pairs = zip(places, keys, strict=True)
        known = [(place, _scaled(quantity, found[key])) for place, key in pairs if key in found]
        if not known:
            continue
        x, aside = np.array([place for place, _ in known], float), apart * (n - (len(part) - 1) / 2)
        x = x * np.exp(aside) if log else x + aside
        mean, low, high = np.array([values for _, values in known]).T
        reach = np.nan_to_num(np.abs([mean - low, high - mean]))
        axes.errorbar(
            x, mean, reach, color=theme.robot(n), marker="o", markersize=3.5, linewidth=1.3, elinewidth=0.9,
            capsize=2, label=theme.short(str(name)) if by else None,
        )  # fmt: skip


def _running(
    axes: "Axes",
    points: Points,
    axis: str,
    by: str | None,
    part: Names,
    quantity: Quantity,
    _: Estimates,
) -> None:
    """Draw a dot at each point's mean (point: set of axis values) and a running mean; a colour per value of `by`."""
    log = logarithmic(points, axis)
    x = points.table[axis].to_numpy(float)
    x = np.log(x) if log else x
    y = np.array([_scaled(quantity, e)[0] if e else np.nan for e in points.estimates[quantity.name]], float)
    reach = WINDOW * float(np.ptp(x))
    for n, name in enumerate(part):
        mine = np.isfinite(y) & ((points.table[by] == name).to_numpy(bool) if by else True)
        if not mine.any():
            continue
        shown = np.flatnonzero(mine)[:: max(1, int(mine.sum()) // MOST_DOTS)]
        color = theme.robot(n)
        back = np.exp if log else np.asarray
        axes.plot(back(x[shown]), y[shown], ".", color=color, markersize=3, alpha=0.35)
        grid = np.linspace(x[mine].min(), x[mine].max(), 60)
        weight = np.exp(-0.5 * ((grid[:, None] - x[mine]) / (reach / 2)) ** 2)
        mean = (weight * y[mine]).sum(1) / weight.sum(1)
        axes.plot(back(grid), mean, color=color, label=theme.short(str(name)) if by else None)


def between(points: Points, axis: str, quantities: Sequence[Quantity]) -> bytes:
    """Return a PNG of quantities with confidence intervals at each value of a non-numeric axis."""
    names = values_of(points, axis)[: MOST_LINES * MOST_PANELS]
    return compared(names, {quantity: points.estimated(quantity, [axis]) for quantity in quantities})


def compared(
    names: Names, found: Mapping[Quantity, Mapping[Any, Estimate | None]], longest_s: float = np.nan
) -> bytes:
    """Return a PNG with a panel per quantity: mean and interval of each name. longest_s: end of the axis of times."""
    with theme.panels(len(found), len(found), max(1.4, 0.7 + 0.24 * len(names)), math=False) as plot:
        for axes, (quantity, estimates) in zip(plot, found.items(), strict=True):
            _intervals(axes, quantity, names, estimates, axes is plot[0])
            if quantity.unit == "s" and np.isfinite(longest_s):
                axes.set_xlim(-0.03 * longest_s, 1.03 * longest_s)
    return plot.png


def _intervals(
    axes: "Axes", quantity: Quantity, names: Names, found: Mapping[Any, Estimate | None], named: bool
) -> None:
    """Draw an interval bar per value of an axis, with the values at the left if `named`."""
    for place, name in enumerate(names):
        estimate = found.get(name)
        if estimate is not None and estimate.n:
            mean, low, high = _scaled(quantity, estimate)
            reach = np.nan_to_num(np.abs([[mean - low], [high - mean]]))
            look = {"color": theme.robot(place), "marker": "o", "markersize": 4.5, "capsize": 2.5}
            axes.errorbar([mean], [place], xerr=reach, **look)
    axes.set_yticks(range(len(names)), [theme.short(str(name)) if named else "" for name in names])
    theme.verbatim(axes.get_yticklabels())
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_title(quantity.heading)
    if quantity.share:
        axes.set_xlim(-3, 103)


# ---------------------------------------------------------------- over two axes


def heat(points: Points, pair: tuple[str, str], by: str | None, q: Quantity) -> bytes:
    """Return a PNG with heat maps of a quantity over a pair of numeric axes, a panel per value of the axis `by`."""
    parts = (values_of(points, by) if by else [None])[:MOST_LINES]
    across, up = (values_of(points, axis) for axis in pair)
    found = points.estimated(q, [*pair, *([by] if by else [])])
    tables = []
    for name in parts:
        keys = [[(x, y, name) if by else (x, y) for x in across] for y in up]
        tables.append([[_scaled(q, found[k])[0] if k in found else np.nan for k in row] for row in keys])
    low, high = (0.0, 100.0) if q.share else (float(np.nanmin(tables)), float(np.nanmax(tables)))

    columns = min(2, len(parts))
    with _panels(len(parts), columns, 2.9) as plot:
        for axes, name, table in zip(plot, parts, tables, strict=True):
            axes.grid(False)
            image = axes.imshow(table, origin="lower", aspect="auto", cmap="viridis", vmin=low, vmax=high)
            turned = 45 if len(across) > 6 else 0
            axes.set_xticks(range(len(across)), [f"{x:.3g}" for x in across], rotation=turned)
            axes.set_yticks(range(len(up)), [f"{y:.3g}" for y in up])
            title = theme.short(str(name)) if by else q.heading
            axes.set(xlabel=label(points, pair[0]), ylabel=label(points, pair[1]), title=title)
            for row, values in enumerate(table if len(across) * len(up) <= 64 else []):
                for place, value in enumerate(values):
                    if np.isfinite(value):
                        theme.note(axes, place, row, f"{value:.3g}", theme.INK)
            plot.figure.colorbar(image, ax=axes, fraction=0.05, pad=0.03).set_label(q.heading, fontsize=7)
    return plot.png


# ---------------------------------------------------------------- kinds


def sensitivity(title: str, indices: dict[str, Index]) -> bytes:
    """Return a PNG bar chart of the first-order and total Sobol indices of the axes, with confidence intervals."""
    with _panels(tall=1.1 + 0.5 * len(indices)) as plot:
        (axes,), place = plot, np.arange(len(indices))
        for n, name in enumerate(("first order: by itself", "total: with the others")):
            index, low, high = np.array([values[3 * n : 3 * n + 3] for values in indices.values()]).T
            reach = np.nan_to_num(np.clip([index - low, high - index], 0, None))
            look = {"color": theme.robot(n), "ecolor": theme.INK, "capsize": 2}
            axes.barh(place + 0.38 * n - 0.19, index, 0.36, xerr=reach, label=name, **look)
        axes.set_yticks(place, [theme.short(name) for name in indices])
        axes.set(ylim=(len(indices) - 0.4, -0.6), xlabel="share of the variance", title=title)
        axes.legend(loc="best")
    return plot.png


def refinement(rows: Sequence[Row], names: Sequence[str], quantity: Quantity) -> bytes:
    """Return a PNG of results over the grid spacing, a line per row, with their extrapolations to zero spacing."""
    title = quantity._replace(share=False).heading  # values are fractions
    with _panels() as plot:
        (axes,) = plot
        for n, (row, name) in enumerate(zip(rows[:MOST_LINES], names, strict=False)):
            label, color = theme.short(name, 40), theme.robot(n)
            axes.plot(row["spacings"], row["values"], "o-", color=color, markersize=4, label=label)
            if np.isfinite(row["extrapolated"]):
                axes.plot(0, row["extrapolated"], "*", color=color, markersize=9, clip_on=False)
        axes.set(xlim=(0, None), xlabel="spacing [m]; stars: extrapolated", title=title)
        if any(names):
            axes.legend(loc="best")
    return plot.png


def _panels(
    count: int = 1, columns: int = 1, tall: float = TALL, below: float = 0.0
) -> AbstractContextManager[theme.Panels]:
    """Return the context of `theme.panels` for panels of height `tall` each [inches], with names from files."""
    return theme.panels(count, columns, tall * -(-count // columns), math=False, below=below)
