"""Write the tables and plots of the validation pages from validation/results.json (see validation/make.py).

A Sphinx extension: before a build it writes validation/trust.md and tables.md, which validation.md includes,
validation/repeated.md, which experiments.md includes, and validation/plots/.
"""

import json
import re
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import trust_picture

GROUPS = (
    (
        "Is the flow right?",
        "Flows with a known solution: decaying vortices, ducts, channels, a lid-driven cavity. They show that the "
        "equations are solved, and how fast errors shrink with the cell size.",
        r"taylor_green|kovasznay|ethier|poiseuille|couette|duct|cavity_\d|drifting_v|oscillating|conduction|"
        r"heated|thermal_plume|one_layer",
    ),
    (
        "Obstacles, openings and walls",
        "The parts of a room: cylinders that shed eddies, pipes oblique to the grid, fans, rotors and their jets, "
        "floors, inflow turbulence, mirrored and rotated rooms. The references are laboratory measurements, or "
        "conservation laws such as that of mass.",
        r"symmetry|bluff|cylinder|shedding|pipe|oblique_channel|room_\dd|fan|hovering|floor|log_layer|inflow|imported",
    ),
    (
        "Is the gas transport right?",
        "A puff must drift with the wind and grow by diffusion; the grid must not bend a thin plume; uniform gas must "
        "stay uniform, and the mass released by a source must be conserved.",
        r"puff_at|puff_drift|puff_moments|shear_|turning|slotted|taylor_dispersion|source_places|oblique_plume|"
        r"well_mixed|mass_budget|plume_on_the_grid|near_source",
    ),
    (
        "Closed forms, gusts and puffs",
        "Plumes in closed form, against other formulas; whiffs and blanks; and turbulent puffs, whose spread must not "
        "depend on the time step, and which must lose no mass at walls.",
        r"steady_plume|release_|plume_in|puff_between|meandering|whiffs|turbulent_whiffs|puffs_",
    ),
    (
        "Published experiments, repeated",
        "Published searches and maps, in many trials, with 95 % confidence intervals over flow realisations (airs). "
        "The papers omit many details, so agreement in ranking and magnitude is the target. What is reproduced, what "
        "is not, and why: [The papers again](experiments.md).",
        r"plumesim_casting|plumesim_hybrid|plumesim_figures|spiral_(gas|persons|table2|scan)|calibration_box|dapso_arena|"
        r"infotaxis_grid|odor_mapping|mapping_scan|measure_next|source_terms",
    ),
    (
        "Measured rooms and plumes",
        "Air and gas measured by others in rooms, channels and wind tunnels. More of them: "
        "[The papers again](experiments.md).",
        r"annex20|backward_step|helium_box|tunnel_plume|red_vapor|plume_edge|open_path|orebro|bouts_distance|sensor_records|room_air",
    ),
)
"""Title, introduction, and a pattern of the names of its cases."""

FLAT = 0.01  # order of errors that do not depend on the resolution, and are not drawn over it
REPEATED = GROUPS[-2:]
"""Groups whose cases are described at length."""


class Known(NamedTuple):
    """Description of a case, independent of its results."""

    about: str
    reference: str
    evidence: str
    discussion: str = ""


WORDS = {True: "met", False: "**not met**", None: ""}
NOT_RUN = "not run"


def setup(app: Any) -> dict[str, Any]:
    """Register the extension in Sphinx."""
    app.connect("builder-inited", lambda app: write(Path(app.srcdir) / "validation"))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def write(folder: Path) -> None:
    """Write tables.md and the plots."""
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    results_made = max(path.stat().st_mtime for path in (folder / "results.json", Path(__file__)))
    plots = folder / "plots"
    plots.mkdir(exist_ok=True)
    for name, result in results.items():
        path = plots / f"{name}.svg"
        if _panels(result) and not (path.exists() and path.stat().st_mtime > results_made):
            _draw(result, path)
    from taichi_plume.validation.cases import CASES

    known = cases()
    texts = {
        "trust.md": trust_picture.write(folder, CASES, results),
        "tables.md": page(known, results),
        "repeated.md": repeated(known, results),
    }
    for name, text in texts.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def cases() -> dict[str, Known]:
    """Description, reference, evidence and discussion of each case."""
    from taichi_plume.validation.cases import CASES

    return {
        name: Known(case.about, case.reference, case.evidence, case.discussion)
        for name, case in CASES.items()
    }


def repeated(cases: dict[str, Known], results: dict[str, Any]) -> str:
    """Page of experiments and measured rooms, with text, figures and plots of each; cases: result of `cases`."""
    parts = []
    for title, _, pattern in REPEATED:
        parts.append(f"## {title}\n")
        for name in [name for name in cases if re.match(pattern, name)]:
            known = cases[name]
            title = f"*{_plain(known.about)}* ({_linked(known.reference)}; evidence: {known.evidence})\n"
            parts += [f"### {name}\n", title]
            parts += [f"{_prose(part)}\n" for part in known.discussion.strip().split("\n\n") if part]
            parts += _figures(results[name]) if name in results else ["Not run for this page.\n"]
    return "\n".join(parts)


def _figures(result: dict[str, Any]) -> list[str]:
    """Tables of judged or published quantities, of the remaining ones, and the plots."""
    if result["message"]:
        return [f"**{_plain(result['message'])}**\n"]
    made = f"{result['date']}, commit `{result['commit'] or '?'}`"
    rows = result.get("rows", [])
    first = [row for row in rows if row["published"] or row["met"] is not None]
    rest = [row for row in rows if row not in first]
    parts = [f"({made})\n"]
    if result.get("norms"):
        parts.append(_table([result["name"]], {result["name"]: Known("", "", "")}, {result["name"]: result}))
    if first:
        parts.append(_means(first))
    if rest:
        parts += ["<details><summary>Further quantities</summary>\n", _means(rest), "</details>\n"]
    if _panels(result):
        parts.append(
            f"```{{image}} validation/plots/{result['name']}.svg\n:alt: plots of {result['name']}\n```\n"
        )
    return parts


def _means(rows: list[dict[str, Any]]) -> str:
    """Table of an experiment; each condition is named once."""
    lines, last = (
        ["| condition | quantity | found | published | target | verdict |", "|---|---|---|---|---|---|"],
        "",
    )
    for row in rows:
        condition = "" if row["condition"] == last else _plain(row["condition"])
        last = row["condition"]
        cells = _plain(row["quantity"]), _found(row), _plain(row["published"]), _limit(row["expected"] or "")
        lines.append(f"| {' | '.join((condition, *cells, WORDS[row['met']]))} |")
    return "\n".join(lines) + "\n"


def page(cases: dict[str, Known], results: dict[str, Any]) -> str:
    """Part of the page that shows the results; cases: result of `cases`."""
    run = [results[name] for name in cases if name in results]
    failed = [one["name"] for one in run if not one["passed"]]
    verdict = f"not all is met by {', '.join(f'`{name}`' for name in failed)}" if failed else "all is met"
    made = sorted({(one["date"], one["versions"]["taichi_plume"], one["commit"] or "?") for one in run})
    when = "; ".join(f"{day} by version {version}, commit `{commit}`" for day, version, commit in made)
    parts = [f"Of {len(cases)} cases, {len(run)} have been run for this page ({when}): {verdict}.\n"]
    parts += ["## At a glance\n", at_a_glance(cases, results)]
    left = dict(cases)
    for title, about, pattern in GROUPS:
        mine = [name for name in left if re.match(pattern, name)]
        if mine:
            parts += [
                f"## {title}\n",
                f"{about}\n",
                _table(mine, cases, results),
                *_plots(mine, cases, results),
            ]
        for name in mine:
            del left[name]
    if left:
        parts += ["## Others\n", _table(list(left), cases, results), *_plots(list(left), cases, results)]
    return "\n".join(parts)


def at_a_glance(cases: dict[str, Known], results: dict[str, Any]) -> str:
    """Table of all cases by kind of evidence and verdict; arguments: see `page`."""
    from taichi_plume.validation.case import EVIDENCE

    verdicts = {name: WORDS[results[name]["passed"]] if name in results else NOT_RUN for name in cases}
    columns = (WORDS[True], WORDS[False], NOT_RUN)
    rows = [f"| evidence | {' | '.join(columns)} |", "|---|---|---|---|"]
    for kind, meaning in EVIDENCE.items():
        mine = [name for name, known in cases.items() if known.evidence == kind]
        names = ([name for name in mine if verdicts[name] == verdict] for verdict in columns)
        cells = (f"{len(some)}: " + ", ".join(f"`{name}`" for name in some) if some else "" for some in names)
        rows.append(f"| **{kind}**: {meaning} | {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def _table(names: list[str], cases: dict[str, Known], results: dict[str, Any]) -> str:
    rows = ["| case | reference | evidence | target | measured | verdict |", "|---|---|---|---|---|---|"]
    for name in names:
        about, reference, evidence, _ = cases[name]
        first = f"{_plain(about)} (`{name}`)", _linked(reference), evidence
        for cells in _judged(results[name]) if name in results else [("", "", NOT_RUN)]:
            rows.append(f"| {' | '.join((*first, *cells))} |")
            first = "", "", ""
    return "\n".join(rows) + "\n"


def _judged(result: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Target, measurement and verdict of every judged quantity."""
    if result["message"]:
        return [("", _plain(result["message"]), WORDS[False])]
    rows = [(*_norm(row), WORDS[row["met"]]) for row in result.get("norms", ()) if row["met"] is not None]
    rows += [(*_mean(row), WORDS[row["met"]]) for row in result.get("rows", ()) if row["met"] is not None]
    return rows or [("", "reported, not judged", "")]


def _norm(row: dict[str, Any]) -> tuple[str, str]:
    size, error = list(row["errors"].items())[-1]
    number = "no number" if error is None else f"{error:.2g}"
    order = "" if row["order"] is None or len(row["errors"]) < 2 else f", order {row['order']:.2f}"
    return f"{_plain(row['norm'])}: {_limit(row['expected'])}", f"{number} at {size}{order}"


def _mean(row: dict[str, Any]) -> tuple[str, str]:
    published = f"; published: {_plain(row['published'])}" if row["published"] else ""
    target = f"{_plain(row['condition'])}, {_plain(row['quantity'])}: {_limit(row['expected'])}"
    return target, f"{_found(row)}{published}"


def _found(row: dict[str, Any]) -> str:
    """Mean with its confidence interval."""
    between = "" if row["low"] is None else f" ({row['low']:.3g} to {row['high']:.3g})"
    mean = "none" if row["mean"] is None else f"{row['mean']:.3g}{between}"
    return f"{mean}, n = {row['n']}" + (f" in {row['airs']} airs" if row.get("airs") else "")


def _linked(reference: str) -> str:
    """Reference with a short link in place of a DOI, which would widen the column."""
    text, _, doi = reference.partition("doi:")
    number = re.match(r"[^\s,;)]+", doi)
    if number is None:
        return _plain(reference)
    rest = _plain(doi[number.end() :])
    return f"{_plain(text)}[doi](https://doi.org/{quote(number[0])}){rest}"


def _limit(expected: str) -> str:
    return expected.replace(">=", "≥").replace("<=", "≤")


def _plain(text: str) -> str:
    """Escape a text for a table cell."""
    return re.sub(r"([\\`*_{}\[\]|$<>~^#])", r"\\\1", text.replace("\n", " "))


def _prose(text: str) -> str:
    """Escape a paragraph, except for the `names` in it."""
    return "`".join(part if n % 2 else _plain(part) for n, part in enumerate(text.split("`")))


# ---------------------------------------------------------------- plots


def _plots(names: list[str], cases: dict[str, Known], results: dict[str, Any]) -> list[str]:
    drawn = [name for name in names if name in results and _panels(results[name])]
    figures = (
        f"```{{figure}} validation/plots/{name}.svg\n:alt: plots of {name}\n\n"
        f"`{name}`: {_plain(cases[name].about)}\n```\n"
        for name in drawn
    )
    return (
        [f"<details><summary>Plots of {len(drawn)} cases</summary>\n", *figures, "</details>\n"]
        if drawn
        else []
    )


def _panels(result: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Titles and pictures to draw; converging errors first."""
    rows = [
        row for row in result.get("norms", ()) if abs(row["order"] or 0.0) > FLAT and len(row["errors"]) > 1
    ]
    first = [("Error over resolution", {"kind": "errors", "rows": rows})] if rows else []
    return first + list(result.get("pictures", {}).items())


def _draw(result: dict[str, Any], path: Path) -> None:
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    panels = _panels(result)
    columns = min(len(panels), 3)
    lines = -(-len(panels) // columns)
    with rc_context({"svg.hashsalt": "validation", "svg.fonttype": "none", "font.size": 8}):
        figure = Figure(figsize=(3.4 * columns, 2.6 * lines), layout="constrained")
        axes = list(figure.subplots(lines, columns, squeeze=False).flat)
        for left_over in axes[len(panels) :]:
            left_over.remove()
        for axis, (title, picture) in zip(axes, panels, strict=False):
            axis.set_title(title.replace("$", r"\$"), fontsize=8)
            DRAWN[picture["kind"]](axis, picture)
        figure.savefig(path, metadata={"Date": None})


def _errors(axis: Any, picture: dict[str, Any]) -> None:
    for row in picture["rows"]:
        known = {int(n): error for n, error in row["errors"].items() if error}
        axis.loglog(list(known), list(known.values()), "o-", markersize=3, linewidth=1, label=row["norm"])
    axis.set(xlabel="cells", ylabel="error")
    axis.legend(fontsize=6)
    axis.grid(alpha=0.3, which="both")


def _curve(axis: Any, picture: dict[str, Any]) -> None:
    axis.plot(picture["x"], _numbers(picture["reference"]), "k-", linewidth=1, label="reference")
    axis.plot(
        picture["x"], _numbers(picture["computed"]), "o", color="#d1495b", markersize=2, label="computed"
    )
    if "fit" in picture:
        axis.plot(picture["x"], _numbers(picture["fit"]), "--", color="#00798c", linewidth=1, label="fitted")
    axis.set(xlabel=picture["x_label"], ylabel=picture["y_label"])
    axis.set_xscale("log" if picture["log_x"] else "linear")
    axis.set_yscale("log" if picture["log_y"] else "linear")
    axis.legend(fontsize=6)
    axis.grid(alpha=0.3)


def _lines(axis: Any, picture: dict[str, Any]) -> None:
    for name, values in picture["lines"].items():
        axis.plot(picture["x"], _numbers(values), ".-", markersize=2, linewidth=1, label=name)
    axis.set(xlabel=picture["x_label"], ylabel=picture["y_label"])
    axis.legend(fontsize=6)
    axis.grid(alpha=0.3)


def _tracks(axis: Any, picture: dict[str, Any]) -> None:
    names = picture.get("names", ())
    for way, name in zip_longest(picture["ways"], names):
        x, y = zip(*way, strict=True)
        axis.plot(x, y, linewidth=0.8, label=name)
        axis.plot(x[0], y[0], "ko", markersize=2)
    if names:
        axis.legend(fontsize=6)
    axis.plot(*picture["source"], "k*", markersize=7)
    axis.set(xlim=(0.0, picture["size"][0]), ylim=(0.0, picture["size"][1]), aspect="equal")
    axis.set(xlabel="x [m]", ylabel="y [m]")


def _plume(axis: Any, picture: dict[str, Any]) -> None:
    import numpy as np
    from matplotlib.colors import LogNorm

    width, height = picture["size"]
    ppm = np.maximum(np.array(picture["ppm"]).T, 1.0)
    extent = (0.0, width, 0.0, height)
    shown = axis.imshow(ppm, origin="lower", extent=extent, cmap="YlOrRd", norm=LogNorm(1.0, 100.0))
    axis.figure.colorbar(shown, ax=axis, label="ppm", shrink=0.7)
    axis.plot(*zip(*picture["nodes"], strict=True), "k+", markersize=3)
    axis.plot(*picture["source"], "k*", markersize=7)
    axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")


def _numbers(values: list[float | None]) -> list[float]:
    return [float("nan") if value is None else value for value in values]


DRAWN = {"errors": _errors, "curve": _curve, "lines": _lines, "tracks": _tracks, "plume": _plume}
