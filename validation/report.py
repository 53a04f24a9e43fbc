"""HTML report of a validation: verdicts, norms and means, and plots of convergence and of computed curves."""

import base64
import io
from collections.abc import Mapping
from html import escape
from itertools import zip_longest
from typing import Any

import numpy as np

from taichi_plume.validation.case import EVIDENCE, Curve, Evidence, Keys
from taichi_plume.validation.experiment import Lines, Picture, Plume, Tracks

Pictures = Mapping[str, Picture]
"""Pictures by title."""

POINTS = 80
"""Largest number of points of a curve in the report's JSON."""

LEAST_PPM, MOST_PPM = 1.0, 100.0
"""Range of the colours of a plume."""

INK = {True: "#2e7d32", False: "#c62828", None: "#777"}
WORD = {True: "met", False: "NOT MET", None: ""}
BADGES: Mapping[Evidence, str] = {
    "exact": "#37474f",
    "law": "#6a4c93",
    "measured": "#00695c",
    "published": "#8d5524",
}
"""Colour of each kind of evidence."""
STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em; color: #222 }
h2 { margin: 2em 0 0.2em; border-top: 1px solid #ddd; padding-top: 1em; font-size: 1.15em }
p { margin: 0.2em 0 } table { border-collapse: collapse; margin: 0.6em 0 } img { max-width: 100% }
th, td { text-align: left; padding: 0.15em 1.2em 0.15em 0; font-variant-numeric: tabular-nums }
th { font-weight: 600; border-bottom: 1px solid #bbb } .about { color: #555 }
.kind { color: #fff; border-radius: 0.7em; padding: 0.05em 0.7em; font-size: 0.8em; font-weight: 600 }
"""


def page(report: Keys, pictures: Mapping[str, Pictures]) -> str:
    """Return the HTML page of a report (see `__main__`); pictures: by name of the case."""
    versions = ", ".join(f"{name} {version}" for name, version in report["versions"].items())
    verdict = "all as expected" if report["passed"] else "not all as expected"
    index = "".join(_index_row(case) for case in report["cases"])
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Validation of taichi_plume</title>'
        f"<style>{STYLE}</style><h1>Validation of taichi_plume</h1>"
        f"<p>{len(report['cases'])} cases in {report['wall_s']:.0f} s on {escape(report['backend'])}: "
        f"<b>{verdict}</b></p><p class=about>{escape(versions)}</p>"
        f"<table><tr><th>case</th><th>what</th><th>against</th><th>evidence</th><th>verdict</th></tr>{index}</table>"
        + "".join(f"<p>{_badge(kind)} {escape(meaning)}</p>" for kind, meaning in EVIDENCE.items())
        + "".join(_case(case, pictures.get(case["name"], {})) for case in report["cases"])
        + "</html>\n"
    )


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


def _index_row(case: Keys) -> str:
    name, verdict = escape(case["name"]), "skipped" if case["skipped"] else _verdict(case["passed"])
    return (
        f'<tr><td><a href="#{name}">{name}</a></td><td>{escape(case["about"])}</td>'
        f"<td>{escape(case['reference'])}</td><td>{_badge(case['evidence'])}</td>"
        f"<td>{verdict}</td></tr>"
    )


def _badge(kind: Evidence) -> str:
    return f'<span class="kind" style="background:{BADGES[kind]}">{kind}</span>'


def _verdict(met: bool | None) -> str:
    return f'<span style="color:{INK[met]}">{WORD[met]}</span>'


def mean_with_interval(row: Keys) -> str:
    """Return the mean in a row of an experiment, with interval and number of values, as text."""
    if row["mean"] is None:
        return "-"
    interval = "" if row["low"] is None else f" ({row['low']:.3g} to {row['high']:.3g})"
    airs = f" in {row['airs']} airs" if row.get("airs") else ""
    return f"{row['mean']:.3g}{interval}, n = {row['n']}{airs}"


def _case(case: Keys, pictures: Pictures) -> str:
    name, about = escape(case["name"]), f"{case['about']} ({case['reference']}), {case['wall_s']:.0f} s"
    message = f'<p style="color:{INK[False]}">{escape(case["message"])}</p>' if case["message"] else ""
    table = _norms(case.get("norms", [])) + _means(case.get("rows", []))
    picture = _picture(case, pictures)
    image = f'<img alt="plots of {name}" src="data:image/svg+xml;base64,{picture}">' if picture else ""
    discussion = "".join(f"<p>{escape(part)}</p>" for part in case["discussion"].split("\n\n") if part)
    title = f'<h2 id="{name}">{name} {_badge(case["evidence"])}</h2>'
    return f"{title}<p class=about>{escape(about)}</p>{message}{discussion}{table}{image}"


def _norms(rows: list[Keys]) -> str:
    sizes = list(dict.fromkeys(n for row in rows for n in row["errors"]))
    return _table(["error", *map(_at, sizes), "order", "expected", ""], [_norm(row, sizes) for row in rows])


def _means(rows: list[Keys]) -> str:
    """Return the HTML table of an experiment's means; each condition is named once."""
    lines, last = [], ""
    for row in rows:
        first = "" if row["condition"] == last else row["condition"]
        last = row["condition"]
        cells = [first, row["quantity"], mean_with_interval(row), row["published"], row["expected"] or ""]
        lines.append([*map(escape, cells), _verdict(row["met"])])
    return _table(["condition", "quantity", "mean, 95 % interval", "published", "expected", ""], lines)


def _table(titles: list[str], lines: list[list[str]]) -> str:
    """Return an HTML table with these titles and cells, which are already HTML; empty without lines."""
    head = "".join(f"<th>{title}</th>" for title in titles)
    rows = ("<tr>" + "".join(f"<td>{cell}</td>" for cell in line) + "</tr>" for line in lines)
    return f"<table><tr>{head}</tr>{''.join(rows)}</table>" if lines else ""


def _at(size: str) -> str:
    return f"at {escape(size)}"


def _norm(row: Keys, sizes: list[str]) -> list[str]:
    errors = [row["errors"].get(n) for n in sizes]
    return [
        escape(row["norm"]),
        *("-" if error is None else f"{error:.2e}" for error in errors),
        "" if row["order"] is None else f"{row['order']:.2f}",
        escape(row["expected"] or ""),
        _verdict(row["met"]),
    ]


# ---------------------------------------------------------------- plots


def _picture(case: Keys, pictures: Pictures) -> str:
    """Return an SVG in base64 with errors over resolution (if an order is expected), curves, tracks; "" without any."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure  # slow to import (half a second)

    from taichi_plume.report.theme import TEXT_AS_TEXT

    norms = case.get("norms", [])
    converging = [row for row in norms if row["order"] is not None and len(row["errors"]) > 1]
    panels = len(pictures) + bool(converging)
    if not panels:
        return ""
    columns = min(panels, 3)
    lines = -(-panels // columns)
    figure = Figure(figsize=(4.2 * columns, 3.2 * lines), layout="constrained")
    axes = list(figure.subplots(lines, columns, squeeze=False).flat)
    for left_over in axes[panels:]:
        left_over.remove()
    if converging:
        _convergence(axes.pop(0), converging)
    for axis, (title, picture) in zip(axes, pictures.items(), strict=False):
        if isinstance(picture, Tracks):
            _tracks(axis, title, picture)
        elif isinstance(picture, Plume):
            _plume(axis, title, picture)
        elif isinstance(picture, Lines):
            _lines(axis, title, picture)
        else:
            _curve(axis, title, picture)
    file = io.BytesIO()
    with rc_context(TEXT_AS_TEXT):
        figure.savefig(file, format="svg")
    return base64.b64encode(file.getvalue()).decode()


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
    axis.grid(alpha=0.3, which="both")


def _curve(axis: Any, title: str, curve: Curve) -> None:
    axis.plot(curve.x, curve.reference, "k-", linewidth=1, label="reference")
    style = "o" if len(curve.x) < 60 else "-"
    axis.plot(curve.x, curve.computed, style, color="#d1495b", markersize=3, linewidth=1, label="computed")
    if curve.fit is not None:
        axis.plot(curve.x, curve.fit, "--", color="#00798c", linewidth=1, label="fitted")
    axis.set(xlabel=curve.x_label, ylabel=curve.y_label, title=title)
    if curve.log_x:
        axis.set_xscale("log")
    if curve.log_y:
        axis.set_yscale("log")
    axis.legend(fontsize=7)
    axis.grid(alpha=0.3)


def _lines(axis: Any, title: str, picture: Lines) -> None:
    for name, values in picture.lines.items():
        axis.plot(picture.x, values, ".-", markersize=3, linewidth=1, label=name)
    axis.set(xlabel=picture.x_label, ylabel=picture.y_label, title=title)
    axis.legend(fontsize=7)
    axis.grid(alpha=0.3)


def _tracks(axis: Any, title: str, tracks: Tracks) -> None:
    for way, name in zip_longest(tracks.ways, tracks.names):
        axis.plot(*way.T, linewidth=0.8, label=name)
        axis.plot(*way[0], "ko", markersize=3)
    if tracks.names:
        axis.legend(fontsize=7)
    axis.plot(*tracks.source, "k*", markersize=9)
    axis.set(xlim=(0.0, tracks.size[0]), ylim=(0.0, tracks.size[1]), aspect="equal", title=title)
    axis.set(xlabel="x [m]", ylabel="y [m]")


def _plume(axis: Any, title: str, plume: Plume) -> None:
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
    axis.set(aspect="equal", title=title, xlabel="x [m]", ylabel="y [m]")
