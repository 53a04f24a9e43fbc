"""The figures of a contest's page."""

from collections.abc import Sequence

import numpy as np

from taichi_plume.contest.fixed import Fixed
from taichi_plume.contest.standings import SUCCESS, TIME, Measure, Row
from taichi_plume.report import look, scene

WIDE = 7.2  # inches
DECADES = 3.0  # of gas that are shown
LOW = 0.5  # ppm, the least that counts as gas


def arena(scenario: Fixed, ppm: np.ndarray) -> bytes:
    """The scene from above with its mean plume (nx, ny) [ppm]."""
    whole = scenario.scenario
    width, length = whole.domain.extent[:2]
    with look.styled():
        figure = look.figure(WIDE, WIDE * length / width * 0.92)
        axes = figure.subplots()
        scene.draw(axes, whole)
        high = max(float(ppm.max()), 10 * LOW)
        low = max(LOW, high / 10**DECADES)
        norm, shown = look.mpl.colors.LogNorm(low, high), np.ma.masked_less(ppm.T, low)
        image = axes.imshow(
            shown, origin="lower", extent=(0, width, 0, length), cmap=look.GAS, norm=norm, zorder=1, alpha=0.9,
            interpolation="bilinear",
        )  # fmt: skip
        bar = figure.colorbar(image, ax=axes, fraction=0.04, pad=0.02)
        bar.set_label("mean gas over a minute [ppm]")
        bar.outline.set_visible(False)
        figure.tight_layout(pad=0.5)
        return look.png(figure)


def compared(rows: Sequence[Row], most: float) -> bytes:
    """Success and time of each algorithm with their intervals, each in a line; most: time of a search [s]."""
    with look.styled({"text.parse_math": False}):
        figure = look.figure(WIDE, 0.9 + 0.25 * len(rows), 100)
        for n, (axes, measure) in enumerate(
            zip(figure.subplots(1, 2, sharey=True), (SUCCESS, TIME), strict=True)
        ):
            look.plain(axes)
            by = 100.0 if measure.share else 1.0
            for place, row in enumerate(rows):
                each = row.estimates[measure.name]
                if each is None or not each.n:
                    continue
                reach = np.nan_to_num(
                    by * np.clip([[each.mean - each.low], [each.high - each.mean]], 0, None)
                )
                axes.errorbar(
                    [by * each.mean], [place], xerr=reach, color=look.robot(place), marker="o", markersize=4.5,
                    capsize=2.5,
                )  # fmt: skip
            axes.set_ylim(len(rows) - 0.5, -0.5)
            if n == 0:
                axes.set_yticks(range(len(rows)), [look.short(row.algorithm) for row in rows])
            axes.set_title(title(measure), fontsize=9)
            high = 100.0 if measure.share else most
            axes.set_xlim(-0.03 * high, 1.03 * high)
        figure.tight_layout(pad=0.6)
        return look.png(figure)


def title(measure: Measure, short: bool = False) -> str:
    """Of a column or a figure, with its unit; short: for a terminal."""
    unit = "%" if measure.share else "" if measure.unit == "1" else measure.unit
    whose = " (successes)" if measure.of == "successes" and not short else ""
    name = measure.brief or measure.title if short else measure.title
    return f"{name}{whose}" + (f" [{unit}]" if unit else "")
