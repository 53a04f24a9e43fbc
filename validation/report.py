"""HTML report of a validation: verdicts, norms and means, and plots of convergence and of computed curves."""

from collections.abc import Iterator, Mapping
from itertools import zip_longest
from typing import Any

import numpy as np

from taichi_plume.report import html
from taichi_plume.report.html import BAD, GOOD, Mark, Section
from taichi_plume.validation.case import EVIDENCE, Curve, Evidence, Keys
from taichi_plume.validation.experiment import Lines, Picture, Plume, Tracks

Pictures = Mapping[str, Picture]
"""Pictures by title."""

POINTS = 80
"""Largest number of points of a curve in the report's JSON."""

LEAST_PPM, MOST_PPM = 1.0, 100.0
"""Range of the colours of a plume."""

VERDICTS = {True: Mark("met", GOOD), False: Mark("NOT MET", BAD), None: ""}
COLORS: Mapping[Evidence, str] = {
    "exact": "#37474f",
    "law": "#6a4c93",
    "measured": "#00695c",
    "published": "#8d5524",
}
"""Colour of each kind of evidence."""


def page(report: Keys, pictures: Mapping[str, Pictures]) -> str:
    """Return the HTML page of a report (see `__main__`); pictures: by name of the case."""
    return html.page(
        _sections(report, pictures), name="Validation of taichi_plume", what="report",
        status="all as expected" if report["passed"] else "not all as expected", good=report["passed"],
        message=f"{len(report['cases'])} cases in {report['wall_s']:.0f} s on {report['backend']}",
        about="Report of a validation", began=[f"{of} {version}" for of, version in report["versions"].items()],
    )  # fmt: skip


def _sections(report: Keys, pictures: Mapping[str, Pictures]) -> Iterator[Section]:
    evidence = {kind: Mark(kind, color) for kind, color in COLORS.items()}
    index = Section(
        "All cases", "cases", [evidence[kind]._replace(beside=EVIDENCE[kind]) for kind in EVIDENCE]
    )
    rows = [
        (Mark(case["name"], to=case["name"]), case["about"], case["reference"], evidence[case["evidence"]],
         "skipped" if case["skipped"] else VERDICTS[case["passed"]])
        for case in report["cases"]
    ]  # fmt: skip
    index.table(rows, ("case", "what", "against", "evidence", "verdict"))
    yield index
    for case in report["cases"]:
        about = f"{case['about']} ({case['reference']}), {case['wall_s']:.0f} s"
        section = Section(case["name"], case["name"], [evidence[case["evidence"]]._replace(beside=about)])
        if case["message"]:
            message = case["message"].removeprefix("skipped: ")
            section.lines.append(Mark("skipped" if case["skipped"] else "failed", BAD, message))
        section.lines += [" ".join(part.split()) for part in case["discussion"].split("\n\n") if part]
        picture = _picture(case, pictures.get(case["name"], {}))
        if picture:
            section.image(picture, "Plots", case["about"])
        section.table(*_norms(case.get("norms", [])))
        section.table(*_means(case.get("rows", [])))
        yield section


def plain(pictures: Pictures) -> Keys:
    """Return pictures as JSON data, thinned to `POINTS` and rounded to four digits, each with its `kind`."""
    return {
        title: {"kind": type(picture).__name__.lower(), **_plain(picture)}
        for title, picture in pictures.items()
    }


def _plain(picture: Picture) -> Keys:
    if isinstance(picture, Tracks):
        ways = [[_numbers(point) for point in _thin(way)] for way in picture.ways]
        names = {"names": list(picture.names)} if picture.names else {}
        return {"size": list(picture.size), "source": list(picture.source), "ways": ways, **names}
    if isinstance(picture, Plume):
        nodes, ppm = ([_numbers(row) for row in rows] for rows in (picture.nodes, picture.ppm))
        return {"size": list(picture.size), "source": list(picture.source), "nodes": nodes, "ppm": ppm}
    axes = {"x_label": picture.x_label, "y_label": picture.y_label, "x": _numbers(_thin(picture.x))}
    if isinstance(picture, Lines):
        return axes | {"lines": {name: _numbers(_thin(line)) for name, line in picture.lines.items()}}
    lines = {"computed": _numbers(_thin(picture.computed)), "reference": _numbers(_thin(picture.reference))}
    if picture.fit is not None:
        lines["fit"] = _numbers(_thin(picture.fit))
    return axes | lines | {"log_x": picture.log_x, "log_y": picture.log_y}


def _thin(values: Any) -> np.ndarray:
    """Return at most `POINTS` of the values, including the first and the last."""
    values = np.asarray(values, float)
    return values[np.unique(np.linspace(0, len(values) - 1, min(len(values), POINTS)).round().astype(int))]


def _numbers(values: np.ndarray) -> list[float | None]:
    return [float(f"{value:.4g}") if np.isfinite(value) else None for value in np.ravel(values)]


def mean_with_interval(row: Keys) -> str:
    """Return the mean in a row of an experiment, with interval and number of values, as text."""
    if row["mean"] is None:
        return "-"
    interval = "" if row["low"] is None else f" ({row['low']:.3g} to {row['high']:.3g})"
    airs = f" in {row['airs']} airs" if row.get("airs") else ""
    return f"{row['mean']:.3g}{interval}, n = {row['n']}{airs}"


def _norms(norms: list[Keys]) -> tuple[list[tuple[Any, ...]], tuple[str, ...]]:
    """Return rows and heads of the table of a case's errors."""
    sizes = list(dict.fromkeys(n for row in norms for n in row["errors"]))
    rows = []
    for row in norms:
        errors = [row["errors"].get(n) for n in sizes]
        cells = ["-" if error is None else f"{error:.2e}" for error in errors]
        order = "" if row["order"] is None else f"{row['order']:.2f}"
        rows.append((row["norm"], *cells, order, row["expected"] or "", VERDICTS[row["met"]]))
    return rows, ("error", *(f"at {n}" for n in sizes), "order", "expected", "")


def _means(means: list[Keys]) -> tuple[list[tuple[Any, ...]], tuple[str, ...]]:
    """Return rows and heads of the table of an experiment's means; each condition is named once."""
    rows, last = [], ""
    for row in means:
        first = "" if row["condition"] == last else row["condition"]
        last = row["condition"]
        cells = first, row["quantity"], mean_with_interval(row), row["published"], row["expected"] or ""
        rows.append((*cells, VERDICTS[row["met"]]))
    return rows, ("condition", "quantity", "mean, 95 % interval", "published", "expected", "")


# ---------------------------------------------------------------- plots


def _picture(case: Keys, pictures: Pictures) -> bytes:
    """Return a PNG with errors over resolution (if an order is expected), curves, tracks; empty without any."""
    from taichi_plume.report import theme  # imports matplotlib, half a second

    norms = case.get("norms", [])
    converging = [row for row in norms if row["order"] is not None and len(row["errors"]) > 1]
    panels = len(pictures) + bool(converging)
    if not panels:
        return b""
    columns = min(panels, 2)
    with theme.panels(panels, columns, 3.0 * -(-panels // columns)) as axes:
        if converging:
            _convergence(axes[0], converging)
        for axis, (title, picture) in zip(axes[bool(converging) :], pictures.items(), strict=True):
            DRAW[type(picture)](axis, picture)
            axis.set_title(title)
    return axes.png


def _convergence(axis: Any, rows: list[Keys]) -> None:
    largest, sizes = 0.0, np.array([])
    for row in rows:
        known = {int(n): error for n, error in row["errors"].items() if error}
        axis.loglog(list(known), list(known.values()), "o-", markersize=4, label=row["norm"])
        if known:
            largest, sizes = max(largest, max(known.values())), np.array(list(known), float)
    if len(sizes):
        axis.loglog(sizes, 1.5 * largest * (sizes / sizes[0]) ** -2, "k:", linewidth=1, label="second order")
    axis.set(xlabel="resolution", ylabel="error", title="Convergence")
    axis.legend(fontsize=7)


def _curve(axis: Any, curve: Curve) -> None:
    axis.plot(curve.x, curve.reference, "k-", linewidth=1, label="reference")
    style = "o" if len(curve.x) < 60 else "-"
    axis.plot(curve.x, curve.computed, style, color="#d1495b", markersize=3, linewidth=1, label="computed")
    if curve.fit is not None:
        axis.plot(curve.x, curve.fit, "--", color="#00798c", linewidth=1, label="fitted")
    axis.set(xlabel=curve.x_label, ylabel=curve.y_label)
    if curve.log_x:
        axis.set_xscale("log")
    if curve.log_y:
        axis.set_yscale("log")
    axis.legend(fontsize=7)


def _lines(axis: Any, picture: Lines) -> None:
    for name, values in picture.lines.items():
        axis.plot(picture.x, values, ".-", markersize=3, linewidth=1, label=name)
    axis.set(xlabel=picture.x_label, ylabel=picture.y_label)
    axis.legend(fontsize=7)


def _tracks(axis: Any, tracks: Tracks) -> None:
    for way, name in zip_longest(tracks.ways, tracks.names):
        axis.plot(*way.T, linewidth=0.8, label=name)
        axis.plot(*way[0], "ko", markersize=3)
    if tracks.names:
        axis.legend(fontsize=7)
    axis.plot(*tracks.source, "k*", markersize=9)
    axis.set(xlim=(0.0, tracks.size[0]), ylim=(0.0, tracks.size[1]), aspect="equal")
    axis.set(xlabel="x [m]", ylabel="y [m]")


def _plume(axis: Any, plume: Plume) -> None:
    from matplotlib.colors import LogNorm

    from taichi_plume.report.theme import GAS

    shown = axis.imshow(
        np.maximum(plume.ppm.T, LEAST_PPM),
        origin="lower",
        extent=(0.0, plume.size[0], 0.0, plume.size[1]),
        cmap=GAS,
        norm=LogNorm(LEAST_PPM, MOST_PPM),
    )
    axis.figure.colorbar(shown, ax=axis, label="ppm", shrink=0.7)
    axis.plot(*plume.nodes.T, "k+", markersize=4)
    axis.plot(*plume.source, "k*", markersize=9)
    axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")


DRAW: Mapping[type, Any] = {Curve: _curve, Lines: _lines, Tracks: _tracks, Plume: _plume}
