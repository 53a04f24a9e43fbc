"""Plots of a page of statistics, as PNG files."""

from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.fluctuations import durations
from taichi_plume.fluctuations.analysis import Correlation, OfProbe, Profile
from taichi_plume.fluctuations.bouts import BoutTable
from taichi_plume.fluctuations.records import AXES
from taichi_plume.fluctuations.sensor_comparison import SensorComparison
from taichi_plume.fluctuations.spectra import KOLMOGOROV
from taichi_plume.report import theme

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 7.4  # inches
FIRST, SECOND, MODEL = theme.robot(0), theme.SOURCE, theme.FAINT
MOST_CURVES = 6
SHOWN = 60.0  # s, of a record


def _axes(columns: int = 1, height: float = 2.9) -> "tuple[Figure, list[Axes]]":
    figure = theme.figure(WIDTH, height)
    axes = figure.subplots(1, columns, squeeze=False)[0]
    for axis in axes:
        theme.plain(axis)
    return figure, axes


def _png(figure: "Figure") -> bytes:
    figure.tight_layout()
    return theme.png(figure)


def laws(stats: OfProbe, step: float) -> bytes:
    """Draw the distribution of durations of whiffs and blanks, with their power laws and T^-3/2."""
    with theme.styled():
        figure, axes = _axes(2, 3.1)
        for axis, kind, color in zip(axes, stats.kinds, (FIRST, SECOND), strict=True):
            found = kind.all.lasted
            t, p, _ = durations.density(found, step)
            axis.loglog(t, p, "o", color=color, markersize=4, label=f"{len(found):,} {kind.name}")
            law = kind.law
            if law is not None:
                inside = ((found > law.first) & (found < law.last)).mean()
                x = np.geomspace(law.first, law.last, 50)
                shapes = (
                    (law.value, "-", f"$T^{{-{law.value:.2f}}}$, fitted"),
                    (durations.CELANI, "--", "$T^{-3/2}$"),
                )
                for exponent, line, label in shapes:
                    s = 1.0 - exponent
                    mass = np.log(law.last / law.first) if abs(s) < 1e-9 else (law.last**s - law.first**s) / s
                    axis.plot(
                        x, inside * x**-exponent / mass, line, color=theme.INK, linewidth=1.1, label=label
                    )
            axis.set_xlabel("duration T [s]")
            axis.set_ylabel("density [1/s]")
            axis.set_title(kind.name)
            axis.legend()
        return _png(figure)


def within(stats: OfProbe) -> bytes:
    """Draw the distribution of concentrations within whiffs, and its fits."""
    with theme.styled():
        figure, (axis,) = _axes()
        most = float(np.quantile(stats.within, 0.999))
        axis.hist(
            stats.within, np.linspace(0.0, most, 61).tolist(), density=True, color="#c9d6e2", label="samples"
        )
        c = np.linspace(most / 400, most, 400)
        for fit, line, color in zip(stats.fits, ("-", "--"), (FIRST, SECOND), strict=True):
            name = {"gamma": "gamma", "lognorm": "lognormal"}[fit.kind]
            axis.plot(c, fit.density(c), line, color=color, label=f"{name}, distance {fit.distance:.3f}")
        top = axis.get_ylim()[1]
        heights = max((float(patch.get_height()) for patch in axis.patches), default=0.0)
        axis.set_ylim(0.0, min(top, 1.6 * heights) if heights else top)
        axis.set_xlabel("concentration over its mean while there is gas")
        axis.set_ylabel("density")
        axis.legend()
        return _png(figure)


def spectrum(several: list[OfProbe]) -> bytes:
    """Draw power spectral densities, with a line of slope -5/3."""
    with theme.styled():
        figure, (axis,) = _axes(1, 3.2)
        for n, stats in enumerate(several[:MOST_CURVES]):
            positive = stats.density > 0
            axis.loglog(
                stats.frequency[positive], stats.density[positive], color=theme.robot(n), linewidth=1.0,
                label=theme.short(stats.probe.name),
            )  # fmt: skip
        first = several[0]
        f, s = first.frequency, first.density
        if len(f) > 4 and s[0] > 0:
            x = np.geomspace(f[len(f) // 20], f[-1], 20)
            at = float(np.interp(x[0], f, s))
            line = 2.0 * at * (x / x[0]) ** KOLMOGOROV
            axis.plot(x, line, "--", color=theme.INK, linewidth=1.0, label="$f^{-5/3}$")
            axis.set_ylim(max(float(s.max()) * 1e-9, float(s[s > 0].min()) / 3), None)
        axis.set_xlabel("frequency f [Hz]")
        axis.set_ylabel("density [ppm²/Hz]")
        for text in axis.legend().get_texts():
            text.set_parse_math(text.get_text().startswith("$f^"))
        return _png(figure)


def profiles(several: list[Profile]) -> bytes:
    """Draw mean and rms along a line, or along some rows of a grid, with the Gaussian of the mean."""
    chosen = several
    if len(several) > 4:
        fitted = [curve for curve in several if curve.gaussian is not None] or several
        chosen = [fitted[k] for k in np.unique(np.linspace(0, len(fitted) - 1, 4).round().astype(int))]
    with theme.styled():
        figure, axes = _axes(2, 3.0)
        for n, curve in enumerate(chosen):
            color, label = theme.robot(n), curve.at or None
            axes[0].plot(curve.place, curve.mean, "o", color=color, markersize=3, label=label)
            if curve.gaussian is not None:
                fine = np.linspace(curve.place.min(), curve.place.max(), 300)
                axes[0].plot(fine, curve.gaussian.at(fine), color=color, linewidth=1.0)
            axes[1].plot(curve.place, curve.rms, "o-", color=color, markersize=3, linewidth=0.8, label=label)
        for axis, title in zip(axes, ("mean [ppm]", "rms of the fluctuation [ppm]"), strict=True):
            axis.set_title(title)
            axis.set_xlabel(f"{chosen[0].along} [m]")
            axis.set_ylim(0.0, None)
        if chosen[0].at:
            axes[0].legend()
        return _png(figure)


def widths(several: list[Profile], along: str) -> bytes | None:
    """Draw width and centre of the mean of each row; None if fewer than three rows have a good fit."""
    fits = [(p, p.gaussian) for p in several if p.gaussian is not None and p.gaussian.share > 0.5]
    if len(fits) < 3:
        return None
    x = [p.station for p, _ in fits]
    with theme.styled():
        figure, axes = _axes(2, 2.6)
        values = (
            ("width [m]", [fit.width for _, fit in fits]),
            (f"centre, {fits[0][0].along} [m]", [fit.centre for _, fit in fits]),
        )
        for axis, (title, y) in zip(axes, values, strict=True):
            axis.plot(x, y, "o-", color=FIRST, markersize=3)
            axis.set_title(title)
            axis.set_xlabel(f"{along} [m]")
        axes[0].set_ylim(0.0, None)
        return _png(figure)


def correlations(several: list[Correlation]) -> bytes:
    """Draw curves of two-point correlation against separation; return a PNG."""
    with theme.styled():
        figure, (axis,) = _axes()
        for n, c in enumerate(several):
            bound = "" if c.whole else "at least "
            label = f"along {c.along}: length {bound}{c.length:.3g} m"
            axis.plot(c.separation, c.values, "o-", markersize=3, color=theme.robot(n), label=label)
        axis.axhline(0.0, color=theme.FAINT, linewidth=0.8)
        axis.set_xlabel("separation [m]")
        axis.set_ylabel("correlation")
        axis.legend()
        return _png(figure)


def maps(x: np.ndarray, y: np.ndarray, values: dict[str, np.ndarray], axes_names: str = AXES) -> bytes:
    """Draw maps over a plane, (x, y) each, one above the other or side by side."""
    wide = np.ptp(x) >= 1.2 * np.ptp(y)
    rows, columns = (len(values), 1) if wide else (1, len(values))
    ratio = np.ptp(y) / max(np.ptp(x), 1e-9)
    height = min(3.2, 6.0 * ratio) * rows + 0.75 * rows if wide else WIDTH / columns * ratio + 0.9
    with theme.styled():
        figure = theme.figure(WIDTH, float(np.clip(height, 2.4, 14.0)))
        plots = figure.subplots(rows, columns, squeeze=False).ravel()
        for axis, (title, grid) in zip(plots, values.items(), strict=True):
            finite = grid[np.isfinite(grid)]
            top = float(np.quantile(finite, 0.995)) if len(finite) else 1.0
            image = axis.pcolormesh(
                x, y, grid.T, cmap=theme.GAS, vmin=0.0, vmax=top or 1.0, shading="nearest"
            )
            axis.set_aspect("equal")
            axis.set_title(title)
            axis.set_xlabel(f"{axes_names[0]} [m]")
            axis.set_ylabel(f"{axes_names[1]} [m]")
            figure.colorbar(image, ax=axis, fraction=0.04, pad=0.02, extend="max")
        return _png(figure)


def records(comparison: SensorComparison, threshold: float, begin: float) -> bytes:
    """Draw the concentration at a point, and the readings of the slow and the fast sensor, in ppm of this gas."""
    n = min(len(comparison.true), max(2, round(SHOWN / comparison.step)))
    first = _liveliest(comparison.true > threshold, n)
    window = slice(first, first + n)
    t = begin + comparison.step * np.arange(first, first + n)
    with theme.styled():
        figure = theme.figure(WIDTH, 4.2)
        plots = figure.subplots(3, 1, sharex=True)
        shown = [("in the air", comparison.true, theme.INK)]
        for k, color in ((1, FIRST), (0, SECOND)):
            sensor = comparison.sensors[k]
            scale = threshold / sensor.threshold if sensor.threshold > 0 else 1.0
            shown.append((sensor.sensor.name, comparison.readings[k] * scale, color))
        for axis, (title, values, color) in zip(plots, shown, strict=True):
            theme.plain(axis)
            axis.plot(t, values[window], color=color, linewidth=0.8)
            axis.axhline(threshold, color=theme.FAINT, linewidth=0.8, linestyle="--")
            axis.set_title(title)
            axis.set_ylabel("ppm")
            axis.set_ylim(0.0, None)
        plots[-1].set_xlabel("time [s]")
        return _png(figure)


def _liveliest(present: np.ndarray, n: int) -> int:
    """Return the start of the window of n samples in which gas comes and goes most often; present: bool (samples,)."""
    changes = np.concatenate([[0], np.cumsum(present[1:] != present[:-1])])
    if len(present) <= n:
        return 0
    return int(np.argmax(changes[n - 1 :] - changes[: len(changes) - n + 1]))


def bouts(table: BoutTable, names: list[str]) -> bytes:
    """Draw the number of bouts and the standard deviation of the signal against the distance from the source.

    names: of the probes.
    """
    with theme.styled():
        figure, axes = _axes(2, 2.9)
        titles = {"bouts per minute": table.per_min, "std of ln(R_air/R)": table.deviation}
        for axis, (title, values) in zip(axes, titles.items(), strict=True):
            for n in np.unique(table.probe)[:MOST_CURVES]:
                here = table.probe == n
                label = theme.short(names[n])
                axis.plot(
                    table.distance[here], values[here], "o", color=theme.robot(n), markersize=3, label=label
                )
            axis.set_title(title)
            axis.set_xlabel("distance from the source [m]")
            axis.set_ylim(0.0, None)
        axes[0].legend()
        return _png(figure)


def sensors(comparison: SensorComparison) -> bytes:
    """Draw the fraction of whiffs that each sensor keeps."""
    with theme.styled():
        figure, (axis,) = _axes(1, 0.34 * len(comparison.sensors) + 0.9)
        y = np.arange(len(comparison.sensors))[::-1]
        colors = [SECOND, FIRST, *[theme.FAINT] * (len(y) - 2)]
        axis.barh(y, [100 * sensor.share for sensor in comparison.sensors], color=colors)
        axis.set_yticks(
            y, [theme.short(sensor.sensor.name, 70) for sensor in comparison.sensors], parse_math=False
        )
        for place, sensor in zip(y, comparison.sensors, strict=True):
            axis.text(100 * sensor.share + 1, place, f"{sensor.share:.0%}", va="center", fontsize=8)
        axis.set_xlim(0, 112)
        axis.set_xlabel("whiffs kept [%]")
        return _png(figure)
