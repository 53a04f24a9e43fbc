"""Figures of a report: mean plume and tracks, sensor readings and behaviour, success over time, scores of maps."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from taichi_plume.files.run_tables import title_of
from taichi_plume.observed.scales import decades, logarithmic
from taichi_plume.report import plume, scene, theme
from taichi_plume.results.run import Run
from taichi_plume.results.tracks import ABOVE, Track

if TYPE_CHECKING:
    from xarray import DataArray

WIDE, DPI = theme.WIDE, theme.DPI
MOST_SERIES = 4  # largest number of robots whose readings are shown
MOST_LANES = 12  # robots whose behaviour is shown
MOST_DECISIONS = 12  # decision quantities that are shown
MOST_POINTS = 1200  # points of a line: more than a page can show
MOST_STATES = 6  # entries side by side in the legend
PLOT, LANE, GAP = 1.1, 0.19, 0.2  # inches: a robot's readings, its behaviour, between them
DECIDED = 0.75  # inches: a decision quantity


def mean_plume(run: Run, picture: "DataArray", tracks: Sequence[Track]) -> bytes:
    """Draw the mean of the recorded pictures, and the robots' tracks."""
    with theme.styled():
        figure, view = plume.figure_of(run, picture, tracks, WIDE, DPI, wind=False)
        end = max([float(picture.time[-1]), *(float(track.t[-1]) for track in tracks)])
        view.show(end, picture.mean("time").values)
        view.trails.set_segments(_trails(tracks) if view.plane == theme.ABOVE else [])
        return theme.png(figure)


def only_tracks(run: Run, tracks: Sequence[Track]) -> bytes:
    """Draw the robots' tracks over the scene."""
    extent = run.scenario.domain.extent
    with theme.styled():
        figure = theme.figure(WIDE, float(np.clip(WIDE * extent[1] / extent[0], 2.4, 8.0)) + 0.4, DPI)
        axes = figure.add_axes((0.08, 0.1, 0.9, 0.86))
        scene.draw(axes, run.scenario, run.shapes, sizes=False, starts=False)
        colors = [theme.robot(track.number) for track in tracks]
        axes.add_collection(LineCollection(_trails(tracks), colors=colors, linewidths=1.3, zorder=8))
        for track in tracks:
            mark = plume.declared_mark(axes, theme.robot(track.number))
            plume.put_mark(mark, track.declared(len(track.t) - 1))
        return theme.png(figure)


def _trails(tracks: Sequence[Track]) -> list[np.ndarray]:
    trails = []
    for track in tracks:
        step = max(1, len(track.t) // MOST_POINTS)
        trails.append(np.column_stack([track.values["x"][::step], track.values["y"][::step]]))
    return trails


# ---------------------------------------------------------------- series


def smelt(run: Run, tracks: Sequence[Track]) -> bytes:
    """Draw readings and true gas of the first robots, and the behaviour of more robots, over a common time axis.

    All share a single pair of axes, in inches upwards: separate axes would double the time of drawing.
    """
    shown, lanes = tracks[:MOST_SERIES], tracks[:MOST_LANES]
    low, high = _ends(run, shown)
    background = sum(run.scenario.backgrounds.values())
    above = " above the background" if background else ""
    tall = len(shown) * PLOT + len(lanes) * LANE + GAP
    below = 0.55 + 0.2 * _legend_rows(_states(lanes))
    whole = tall + below + 0.4
    with theme.styled():
        figure = theme.figure(WIDE, whole, DPI)
        axes = figure.add_axes((0.12, below / whole, 0.86, tall / whole))
        axes.spines[["top", "right", "left"]].set_visible(False)
        ends = [(track.t[0], track.t[-1]) for track in lanes]
        axes.set_xlim(min(begin for begin, _ in ends), max(max(end for _, end in ends), 1e-3))
        axes.set_ylim(0, tall)
        axes.set_xlabel("time [s]")
        places, labels = _behaviour(axes, lanes)
        for n, track in enumerate(shown):
            marks = _readings(axes, track, tall - (n + 1) * PLOT, low, high, background)
            places += [place for place, _ in marks]
            labels += [label for _, label in marks]
        axes.set_yticks(places, labels=labels)
        theme.verbatim(axes.get_yticklabels())
        axes.tick_params(axis="y", length=0)
        handles: list[Artist] = [
            Patch(facecolor=theme.TRUE_GAS, label=f"true gas at the sensor{above} [ppm]"),
            Line2D([], [], color=theme.INK, label=f"reading of the sensor{above} [ppm]"),
        ]
        if any(track.group.algorithm.threshold is not None for track in shown):
            style = {"color": theme.SOURCE, "linestyle": "--", "linewidth": 0.9}
            handles.append(Line2D([], [], label="threshold", **style))
        figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.11, 1), ncols=3, borderaxespad=0.2)
        return theme.png(figure)


def decisions(tracks: Sequence[Track]) -> bytes | None:
    """Draw the decision quantities of the first robots over time, a row for each; None if no robot has any."""
    shown = tracks[:MOST_SERIES]
    names = [
        name for name in (shown[0].decisions if shown else ())
        if any(np.isfinite(track.values[name]).any() for track in shown)
    ][:MOST_DECISIONS]  # fmt: skip
    if not names:
        return None
    ends = min(track.t[0] for track in shown), max(max(track.t[-1] for track in shown), 1e-3)
    with theme.panels(len(names), tall=len(names) * DECIDED + 0.7, math=False, sharex=True) as plot:
        for axes, name in zip(plot, names, strict=True):
            for track in shown:
                t, values = thinned(track.t, track.values[name])
                look = {"color": theme.robot(track.number), "linewidth": 1.2, "drawstyle": "steps-post"}
                axes.plot(t, values, label=theme.short(track.name), **look)
            label = theme.short(title_of(name, shown[0].decisions[name]), 60)
            axes.set_title(label, fontsize=8, pad=2)
        plot[-1].set(xlim=ends, xlabel="time [s]")
        plot[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=MOST_SERIES, borderaxespad=0)
    return plot.png


def _ends(run: Run, tracks: Sequence[Track]) -> tuple[float, float]:
    """Return the whole decades between which the readings are shown [ppm]."""
    background = sum(run.scenario.backgrounds.values())
    values = [
        track.values[key] - less for track in tracks for key, less in ((ABOVE, 0.0), ("true_ppm", background))
    ]
    largest = max((float(np.nanmax(series, initial=0.0)) for series in values), default=0.0)
    low = 10.0 ** np.floor(np.log10(run.scenario.recording.range_ppm[0]))
    return low, max(10.0 ** np.ceil(np.log10(max(largest, low))), 100 * low)


def _readings(
    axes: Axes, track: Track, base: float, low: float, high: float, background: float
) -> list[tuple[float, str]]:
    """Draw a robot's true gas (area) and reading (line) above the background [ppm], logarithmic, above `base`.

    Return the scale's marks.
    """

    def up(ppm: np.ndarray | float) -> np.ndarray:
        return base + (PLOT - GAP) * logarithmic(np.asarray(ppm), low, high)

    color = theme.robot(track.number)
    axes.axhline(base, color=theme.FAINT, linewidth=0.6)
    t, true = thinned(track.t, track.values["true_ppm"] - background)
    axes.fill_between(t, up(true), base, color=theme.TRUE_GAS, linewidth=0)
    t, reading = thinned(track.t, track.values[ABOVE])
    axes.plot(t, up(reading), color=color, linewidth=1.4, path_effects=theme.HALO)
    threshold = track.group.algorithm.threshold
    if threshold is not None:
        axes.axhline(float(up(threshold)), color=theme.SOURCE, linewidth=0.9, linestyle="--")
    if track.found_at is not None:
        at = track.t[track.found_at]
        axes.plot([at, at], [base, base + PLOT - GAP], color=theme.FOUND, linewidth=1.4)
    name = f" {theme.short(track.name)}"
    theme.note(axes, axes.get_xlim()[0], base + PLOT - GAP, name, theme.INK, ha="left", va="top")
    marks = decades(low, high)
    return [(base + (PLOT - GAP) * place, label) for place, label in marks[:: max(1, round(len(marks) / 3))]]


def _behaviour(axes: Axes, tracks: Sequence[Track]) -> tuple[list[float], list[str]]:
    """Draw a lane per robot at the bottom, coloured by state; return positions and texts of the robots' names."""
    names = _states(tracks)
    color_of = theme.state_colors(name for track in tracks for name in track.states)
    boxes, colors = [], []
    places = [(len(tracks) - lane - 0.5) * LANE for lane in range(len(tracks))]
    for place, track in zip(places, tracks, strict=True):
        cuts = np.flatnonzero(np.diff(track.state)) + 1
        begins, ends = np.concatenate([[0], cuts]), np.concatenate([cuts, [len(track.t) - 1]])
        stride = max(1, len(begins) // MOST_POINTS)
        low, high = place - 0.4 * LANE, place + 0.4 * LANE
        for begin, end in list(zip(begins, ends, strict=True))[::stride]:
            left, right = track.t[begin], track.t[end]
            boxes.append([(left, low), (right, low), (right, high), (left, high)])
            colors.append(color_of[track.states[track.state[begin]]])
        if track.found_at is not None:
            star = {"color": theme.FOUND, "markeredgecolor": "white", "markersize": 10, "clip_on": False}
            axes.plot(track.t[track.found_at], place, "*", **star)
    axes.add_collection(PolyCollection(boxes, facecolors=colors, linewidths=0))
    marks = [Patch(facecolor=color_of[name], label=theme.short(name)) for name in names]
    below = -0.48 / (axes.get_position().height * axes.figure.get_figheight())
    legend = axes.legend(
        handles=marks, loc="upper left", bbox_to_anchor=(0, below), ncols=_columns(names), borderaxespad=0,
        columnspacing=1.0, handlelength=1.0,
    )  # fmt: skip
    theme.verbatim(legend.get_texts())
    return places, [theme.short(track.name, 12) for track in tracks]


def _states(tracks: Sequence[Track]) -> list[str]:
    """Return the distinct names of the states in which robots were, in the order of the algorithms' states."""
    occurring = {track.states[k] for track in tracks for k in np.unique(track.state)}
    return [
        name for name in dict.fromkeys(name for track in tracks for name in track.states) if name in occurring
    ]


def _columns(names: Sequence[str]) -> int:
    """Return the number of columns of a legend that holds these names, by the longest name."""
    longest = max((len(theme.short(name)) for name in names), default=0)
    return max(1, min(MOST_STATES, 80 // (longest + 5)))


def _legend_rows(names: Sequence[str]) -> int:
    return -(-len(names) // _columns(names))


def thinned(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Thin a long time series to the least and largest value of each of its parts, so that no peak is lost."""
    parts = len(t) // (MOST_POINTS // 2)
    if parts < 2:
        return t, values
    n = len(t) // parts * parts
    table = values[:n].reshape(-1, parts)
    rows = np.arange(len(table))
    filled = np.where(np.isfinite(table), table, -np.inf)
    first = np.where(np.isfinite(table), table, np.inf).argmin(axis=1)
    chosen = np.sort(np.stack([rows * parts + first, rows * parts + filled.argmax(axis=1)]), axis=0).T.ravel()
    return t[chosen], values[chosen]


# ---------------------------------------------------------------- trials


def success(groups: Sequence[dict[str, Any]], end: float) -> bytes:
    """Draw the fraction of each group's trials in which a source had been found by a time."""
    with theme.panels(tall=2.6, math=False) as plot:
        (axes,) = plot
        for n, group in enumerate(groups):
            times = np.sort([t for t in group["per_trial"]["time_s"] if t is not None])
            share = np.arange(len(times) + 1) / group["trials"]
            label = f"{theme.short(group['name'])} ({group['trials']} trials)"
            axes.step([0, *times, end], [*share, share[-1]], where="post", color=theme.robot(n), label=label)
        axes.set(xlim=(0, end), ylim=(0, 1.02), xlabel="time since the robots started [s]")
        axes.set_ylabel("fraction of trials")
        axes.legend(loc="upper left")
    return plot.png


# ---------------------------------------------------------------- maps


def scores(maps: Sequence[dict[str, Any]], names: Sequence[str], titles: Mapping[str, str]) -> bytes | None:
    """Draw two scores of the maps over time, those that `titles` names; None if no map has them."""
    scored = [
        (name, series)
        for name, result in zip(names, maps, strict=True)
        for series in (result.get("mean_gas", {}), result.get("mean_wind", {}))
        if series.get("time_s") and titles.keys() <= series.keys()
    ]
    if not scored:
        return None
    with theme.panels(2, 2, 2.4, math=False) as plot:
        for axes, (key, label) in zip(plot, titles.items(), strict=True):
            for n, (name, series) in enumerate(scored):
                t, values = thinned(np.array(series["time_s"]), np.array(series[key], float))
                marker = "o" if len(series["time_s"]) == 1 else ""
                axes.plot(t, values, color=theme.robot(n), label=name, marker=marker, markersize=4)
            axes.set(xlabel="time [s]", title=label)
        plot[0].legend(loc="best")
    return plot.png
