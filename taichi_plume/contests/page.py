"""HTML page of a contest of search algorithms (`contest.html`): standings, and each scenario with its mean plume."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from taichi_plume.contests.execution import SCENARIOS, Contest, Fixed
from taichi_plume.contests.standings import DECLARING, ERROR, MEASURES, SUCCESS, TIME, Row, Standings, notes
from taichi_plume.files.disk import written_whole
from taichi_plume.guard.safe_open import open_regular
from taichi_plume.report import html, scene, theme
from taichi_plume.report.html import Section
from taichi_plume.scoring.trials import LEAST_VALUES
from taichi_plume.studies.intervals import FEWEST
from taichi_plume.studies.plots import compared

DECADES, LOW = 3.0, 0.5  # range of the colour scale, and its lower bound [ppm]
SHOWN, EVERY = 60.0, 1.0  # s: duration of the mean plume, and between its samples
MEASURED = (
    "A search is successful if a robot comes within 0.25 m of a source within the scenario's time; the robot is then "
    "stopped. NAME_declares is the algorithm NAME judged by its declarations: a search is successful if the first "
    "declared position is within 0.25 m of a source, and the first declaration ends the search, right or wrong. "
    "Time and way are those of successful searches; time with failures counts a failure with the whole time. "
    "Way / shortest way: length of the robot's path over the shortest path, around obstacles, from its start to the "
    "nearest source.",
    "Some algorithms declare a position of the source. Localisation error: distance from the declared position to the "
    "nearest source at that time, for the first right declaration of a search or, without one, the last declaration. A "
    "declaration is false if no source is within 0.25 m. Strength error: of declarations that carry a strength; others "
    "have none. Outcome of a search: declared (a robot declared a source rightly), "
    "reached (no robot did, but a robot reached a source), neither. "
    "Robots that stop at a source before they declare have no declaration to judge: see NAME_declares for these.",
    "95 % confidence intervals are over airs: searches in one air are correlated, so whole airs are resampled with all "
    "their searches (cluster bootstrap). Success has Wilson's interval, in which each air counts once, if each air has "
    f"one search, if all airs have equal results, or if there are fewer than {FEWEST} airs. Then means have Student's "
    "interval on a scale without limits: the logarithm or, for times, which end with the run, the logit. So intervals "
    f"keep to the range of their quantity. There are no intervals below {LEAST_VALUES} airs. "
    "If the air does not depend on random numbers, success has Wilson's interval over the searches.",
    "All algorithms have the same robot, sensors, time, airs and starts: start k of air n is the same position for all "
    "of them. In the scenario drone the robot flies: algorithms of the floor stay at the altitude of the start, and "
    "those that climb take part only there. One robot searches, except for DAPSO, a swarm of five, whose time is that "
    "of the first to find a source. "
    "All algorithms have their defaults and are given these facts of the plume: threshold_ppm, a tenth of the highest "
    "mean concentration in the start area, at least 2 ppm, and the mean wind speed.",
)
WHOLE = (
    f"In brackets the 95 % interval over airs, from {LEAST_VALUES} airs on. The last column is the plain mean over the "
    "scenarios; random_walk is the baseline: an algorithm that is not better gains nothing from the gas."
)
FACTS = "Facts of the plume that all algorithms are given:"
ARENA = (
    "Mean gas at the sensors' height in the first minute of the first air, logarithmic; stars are sources."
)
COMPARED = (
    f"Means with 95 % confidence intervals over airs, from {LEAST_VALUES} airs on. A mean time of few successes is "
    "uncertain."
)
TABLE = (
    f"In brackets 95 % confidence intervals over airs; none without data and none below {LEAST_VALUES} airs."
)
WORDS = "Algorithms that declared a position: distance to the nearest source, and outcomes of the searches."
FAILED = "Failed runs count neither as found nor as not found."


def write(standings: Standings) -> Path:
    """Write a contest's HTML page; return its path. Raises OSError, ScenarioError."""
    rows = standings.rows
    runs, left = sum(row.runs for row in rows), sum(row.failed + row.missing for row in rows)
    return html.write(
        standings.page, _sections(standings.contest, rows),
        name="Contest of search algorithms", what="taichi_plume", about="Page of a contest of taichi_plume",
        status=f"{runs - left:,} of {runs:,} runs", good=not left,
    )  # fmt: skip


def _sections(contest: Contest, rows: Sequence[Row]) -> Iterator[Section]:
    started = [each for each in contest.scenarios if any(row.scenario == each.name for row in rows)]
    yield _whole(contest, [each.name for each in started], rows)
    for scenario in started:
        yield _scenario(contest, scenario, [row for row in rows if row.scenario == scenario.name])
    failures = Section("What failed", "failed")
    failed = [row for row in rows if row.failed]
    cells = [
        (f"{row.algorithm} in {row.scenario}", f"{row.failed} of {row.runs}", row.message) for row in failed
    ]
    failures.table(cells, ("", "runs", "message"), FAILED)
    yield failures
    yield Section("How it was measured", "measured", lines=list(MEASURED))
    yield Section("How to repeat it", "again", lines=[contest.again], code=True)


def _whole(contest: Contest, names: Sequence[str], rows: Sequence[Row]) -> Section:
    """Return the page section with the success of each algorithm in each scenario, sorted by mean, the best first."""
    table = []
    for entrant in contest.entrants:
        found = {row.scenario: row.estimates[SUCCESS.name] for row in rows if row.algorithm == entrant.name}
        estimates = [found.get(name) for name in names]
        mean = sum(each.mean if each else np.nan for each in estimates) / max(1, len(names))
        text = f"{100 * mean:.0f} %" if np.isfinite(mean) else "-"
        table.append((-np.nan_to_num(mean, nan=-1.0), (entrant.name, *map(SUCCESS.cell, estimates), text)))
    searches = f"{contest.searches} searches in each of {contest.airs} airs"
    section = Section("Success", "success")
    section.lines.append(f"{len(contest.entrants)} algorithms in {len(names)} scenarios, {searches}.")
    ranked = [cells for _, cells in sorted(table, key=lambda pair: pair[0])]
    section.table(ranked, (SUCCESS.heading, *names, "mean"), WHOLE)
    section.lines += notes(rows)
    return section


def _scenario(contest: Contest, scenario: Fixed, rows: Sequence[Row]) -> Section:
    section = Section(scenario.name, scenario.name, lines=list(scenario.about))
    facts = ", ".join(f"{key} {value:g}" for key, value in scenario.facts.items())
    section.lines.append(f"{FACTS} {facts}.")
    plume = mean_plume(scenario, contest.out / SCENARIOS)
    section.image(arena(scenario, plume), f"{scenario.name} from above", ARENA)
    of = {
        q: {row.algorithm: e for row in rows if (e := row.estimates[q.name]) and e.n} for q in (SUCCESS, TIME)
    }
    picture = compared([row.algorithm for row in rows], of, scenario.scenario.duration)
    section.image(picture, "Success and time", COMPARED)
    declaring = [row for row in rows if row.estimates[ERROR.name]]
    others = [each for each in MEASURES if each not in DECLARING]
    for part, shown, caption in ((rows, others, TABLE), (declaring, DECLARING, WORDS)):
        table = [(row.algorithm, *(q.cell(row.estimates[q.name]) for q in shown)) for row in part]
        section.table(table, ("algorithm", *(q.heading for q in shown)), caption)
    words = [(row.algorithm, SUCCESS.words(row.estimates[SUCCESS.name])) for row in rows]
    section.table(words, ("success in words", ""))
    return section


def arena(scenario: Fixed, ppm: np.ndarray) -> bytes:
    """Return a PNG of a scenario from above with its mean plume `ppm`, (nx, ny) [ppm]."""
    width, length = scenario.scenario.domain.extent[:2]
    high = max(float(ppm.max()), 10 * LOW)
    low = max(LOW, high / 10**DECADES)
    with theme.panels(tall=theme.WIDE * length / width * 0.92) as plot:
        (axes,) = plot
        axes.grid(False)
        scene.draw(axes, scenario.scenario)
        look = {"cmap": theme.GAS, "norm": theme.mpl.colors.LogNorm(low, high), "zorder": 1, "alpha": 0.9}
        shown, extent = np.ma.masked_less(ppm.T, low), (0, width, 0, length)
        image = axes.imshow(shown, origin="lower", extent=extent, interpolation="bilinear", **look)
        bar = plot.figure.colorbar(image, ax=axes, fraction=0.04, pad=0.02)
        bar.set_label("mean gas over a minute [ppm]")
        bar.outline.set_visible(False)
    return plot.png


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
    from taichi_plume.observed.observer import Observer
    from taichi_plume.observed.views import output_view
    from taichi_plume.scenario.outputs import Output
    from taichi_plume.time_loop import Every

    whole = scenario.scenario
    program.ensure_started()
    sim = assemble(whole.model_copy(update={"robots": (), "duration": min(SHOWN, whole.duration)}))
    height = whole.robots[0].sensors.nose.height if sim.grid.dim == 3 else None
    observer = Observer(sim, [output_view(sim, Output(at=height), scenario.name)])
    pictures: list[np.ndarray] = []
    sim.observers.append(Every(EVERY, lambda sim: pictures.extend(observer.observe(sim).values())))
    sim.run()
    return np.nan_to_num(np.mean(pictures, axis=0))
