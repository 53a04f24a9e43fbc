"""Figures of a contest's page: the mean plume from above, and success and search time of the algorithms."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from taichi_plume.contests.fixed_scenarios import Fixed
from taichi_plume.contests.standings import ERROR, FALSE, LATE, SUCCESS, TIME, WAY, Row
from taichi_plume.files.disk import written_whole
from taichi_plume.guard.safe_open import open_regular
from taichi_plume.report import scene, theme
from taichi_plume.studies.estimates import Quantity
from taichi_plume.studies.plots import interval_bar

WIDE = 7.2  # inches
DECADES = 3.0  # range of the colour scale
LOW = 0.5  # ppm, lower bound of the colour scale
SHOWN = 60.0  # s, duration of the mean
EVERY = 1.0  # s between samples of the mean
POINTS = 120  # points along the longer side
BRIEF = {LATE: "with fails", WAY: "way", ERROR: "error", FALSE: "false"}
"""Titles in a terminal."""


def arena(scenario: Fixed, ppm: np.ndarray) -> bytes:
    """Return a PNG of a scenario from above with its mean plume `ppm`, (nx, ny) [ppm]."""
    whole = scenario.scenario
    width, length = whole.domain.extent[:2]
    with theme.styled():
        figure = theme.figure(WIDE, WIDE * length / width * 0.92)
        axes = figure.subplots()
        scene.draw(axes, whole)
        high = max(float(ppm.max()), 10 * LOW)
        low = max(LOW, high / 10**DECADES)
        norm, shown = theme.mpl.colors.LogNorm(low, high), np.ma.masked_less(ppm.T, low)
        image = axes.imshow(
            shown, origin="lower", extent=(0, width, 0, length), cmap=theme.GAS, norm=norm, zorder=1, alpha=0.9,
            interpolation="bilinear",
        )  # fmt: skip
        bar = figure.colorbar(image, ax=axes, fraction=0.04, pad=0.02)
        bar.set_label("mean gas over a minute [ppm]")
        bar.outline.set_visible(False)
        figure.tight_layout(pad=0.5)
        return theme.png(figure)


def compared(rows: Sequence[Row], most: float) -> bytes:
    """Return a PNG of success and search time of each algorithm with intervals; most: duration of a search [s]."""
    with theme.styled({"text.parse_math": False}):
        figure = theme.figure(WIDE, 0.9 + 0.25 * len(rows), 100)
        for axes, quantity in zip(figure.subplots(1, 2, sharey=True), (SUCCESS, TIME), strict=True):
            theme.plain(axes)
            for place, row in enumerate(rows):
                estimate = row.estimates[quantity.name]
                if estimate is not None and estimate.n:
                    interval_bar(axes, place, quantity, estimate)
            axes.set_ylim(len(rows) - 0.5, -0.5)
            if quantity is SUCCESS:
                axes.set_yticks(range(len(rows)), [theme.short(row.algorithm) for row in rows])
            axes.set_title(title(quantity), fontsize=9)
            high = 100.0 if quantity.share else most
            axes.set_xlim(-0.03 * high, 1.03 * high)
        figure.tight_layout(pad=0.6)
        return theme.png(figure)


def title(quantity: Quantity, short: bool = False) -> str:
    """Return the title of a quantity for a table column or figure, with its unit; short: shortened for a terminal."""
    unit = "%" if quantity.share else "" if quantity.unit == "1" else quantity.unit
    whose = " (successes)" if quantity.what == "successes" and not short else ""
    name = BRIEF.get(quantity, quantity.title) if short else quantity.title
    return f"{name}{whose}" + (f" [{unit}]" if unit else "")


def mean_plume(scenario: Fixed, folder: Path) -> np.ndarray:
    """Mean concentration [ppm], (nx, ny), over the first minute of a scenario, at the height of the gas sensors.

    The mean is cached in `folder`, beside the scenario. Raises ScenarioError, OSError.
    """
    path = folder / f"{scenario.name}.plume.npz"
    key = repr(scenario.data)
    # the cached file may be absent or truncated
    with suppress(OSError, ValueError, LookupError, EOFError, BadZipFile), open_regular(path) as file:
        held = np.load(file)
        if str(held["key"]) == key:
            return held["ppm"]
    ppm = _computed(scenario)
    with written_whole(path) as fresh, fresh.open("wb") as file:
        np.savez_compressed(file, ppm=ppm, key=np.array(key))
    return ppm


def _computed(scenario: Fixed) -> np.ndarray:
    from taichi_plume.assembly.assemble import assemble
    from taichi_plume.engine import program
    from taichi_plume.grid import fields
    from taichi_plume.time_loop import Every

    whole = scenario.scenario
    end = min(SHOWN, whole.duration)
    alone = whole.model_copy(update={"robots": (), "duration": end})
    program.ensure_started()
    sim = assemble(alone)
    width, length = whole.floor.size
    step = max(width, length) / POINTS
    axes = [(np.arange(round(size / step)) + 0.5) * step for size in (width, length)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    if sim.grid.dim == 3:
        height = whole.robots[0].sensors.nose.height
        points = np.concatenate([points, np.full((*points.shape[:2], 1), height)], axis=-1)
    total, count = np.zeros(points.shape[:2]), 0

    def add(sim) -> None:
        nonlocal count
        if sim.t >= 0:
            total[:] += fields.excess_at(sim.gas, points, sim.t).sum(axis=-1)
            count += 1

    sim.observers.append(Every(EVERY, add))
    sim.run()
    return (total / max(1, count)).astype(np.float32)
