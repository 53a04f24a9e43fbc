"""Report of a run, `report.html`: a page with embedded images, without scripts, that needs no network."""

from collections.abc import Callable, Iterator
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from taichi_plume.execution import summary
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.tables import plain
from taichi_plume.report import captions, facts, figures, html, maps, scene
from taichi_plume.report.html import Section
from taichi_plume.report.references import papers
from taichi_plume.results.pictures import has_pictures, picture_names, pictures
from taichi_plume.results.run import Run

if TYPE_CHECKING:
    from xarray import DataArray

NAME = "report.html"
MOST_FRAMES = 240  # largest number of pictures of a recording for its mean
COMPLETE = {"wall_s", "simulated_s", "cells", "steps", "backend", "flow", "gas", "groups", "maps"}
"""Keys of a complete result; results of killed runs have fewer."""
Value = TypeVar("Value")


def write(run: Run, tolerant: bool | None = None) -> Path:
    """Write the report of a run into the run's folder; return the path.

    tolerant: whether unreadable files only cause a note on the page; by default only for unfinished runs. Raises
    RunFolderError and OSError.
    """
    parts = Parts(run, run.unfinished if tolerant is None else tolerant)
    message = str(run.result.get("message") or "")
    return html.write(
        run.folder / NAME, parts.all(), name=run.scenario.name, status=parts.ending(),
        good=run.status in ("completed", "stopped"), message=message, began=run.header[1:],
    )  # fmt: skip


class Parts:
    """Sections of the HTML report of a run. A reading error is raised or, if `tolerant`, noted on the page."""

    def __init__(self, run: Run, tolerant: bool):
        self.run, self.tolerant = run, tolerant
        self.result = run.result if run.result.keys() >= COMPLETE else {}
        self.lacks = list(run.lacks)
        self.tracks = self._tried(lambda: run.tracks, [])

    def ending(self) -> str:
        """Return how the run ended in a few words, for the box below the page's heading."""
        return self._of_result(lambda: summary.ending(self.run.result), self.run.status)

    def _tried(self, read: Callable[[], Value], without: Value) -> Value:
        try:
            return read()
        except RunFolderError as error:
            if not self.tolerant:
                raise
            self.lacks.append(f"{error}.")
            return without

    def all(self) -> Iterator[Section]:
        """Yield the sections of the report in reading order; some may be empty."""
        nothing = Section("", "")
        yield self._of_result(self.words, nothing)
        yield self.setting()
        yield self._of_result(self.trials, nothing)
        yield self.plume()
        yield self.smelt()
        for make in (self.maps, self.beliefs, self.balance):
            yield self._of_result(make, nothing)
        for make in (self.notes, self.citing, self.again):
            yield make()

    def _of_result(self, make: Callable[[], Value], without: Value) -> Value:
        """Return what `make` builds from the run's result; an unusable result counts as a reading error."""

        def made() -> Value:
            try:
                return make()
            except RunFolderError:
                raise
            except (LookupError, TypeError, AttributeError, ValueError) as error:
                why = plain(" ".join(f"{type(error).__name__}: {error}".split()))
                path = self.run.folder / "result.json"
                raise RunFolderError(f"{path}: is damaged, or of another version: {why}") from error

        return self._tried(made, without)

    def words(self) -> Section:
        """Return the report's section with the run's result in words, as the run command prints the result."""
        section = Section("The result in words", "words")
        if self.result:
            section.table(summary.summary(self.result)[1:])
            return section
        if self.run.unfinished:
            section.lines.append(captions.UNFINISHED.format(status=self.run.status, folder=self.run.folder))
        for group in self.run.result.get("groups", []):
            if "found" in group:
                of = group.get("robots_of_all_trials", "?")
                name, found = group.get("name"), group["found"]
                section.lines.append(f"{name}: {found} of {of} robots had found a source.")
        return section

    def setting(self) -> Section:
        """Return the report's section with a drawing of the scene and a table of key facts."""
        run = self.run
        seen = "from above" if run.scenario.domain.dim == 2 else "from above and from the side"
        robots = "; coloured discs are the robots at their start" if run.scenario.robots else ""
        caption = captions.SCENE.format(seen=seen, robots=robots)
        section = Section("Scenario", "setting")
        section.image(scene.picture(run.scenario, run.shapes, figures.DPI), "The scene", caption)
        section.table(facts.key_facts(run))
        return section

    def trials(self) -> Section:
        """Return the report's section with each group's success rate and search times, with 95 % intervals."""
        section = Section("Success and times", "trials")
        groups = self.result.get("groups", [])
        searched = [group for group in groups if not group["no_search"]]
        for group in searched:
            heads = (group["name"], "mean or count", "95 % interval", "over")
            caption = captions.TRIALS if group["trials"] > 1 else ""
            section.table(facts.trials(group), heads, caption)
        for group in groups:
            if group["no_search"]:
                section.lines.append(f"{group['name']}: no search took place: {group['no_search']}.")
        for group in groups:
            if group.get("shares_arena_with"):
                others = ", ".join(group["shares_arena_with"])
                section.lines.append(captions.SHARED.format(name=group["name"], others=others))
        many = [group for group in searched if group["trials"] > 4 and group["trials_differ_by"] != "nothing"]
        if many:
            end = max(float(self.result["simulated_s"]) + self.run.begin, 1e-3)
            section.image(figures.success(many, end), "Success over time", captions.SUCCESS)
        return section

    def plume(self) -> Section:
        """Return the report's section with the time mean of each recorded picture, and the robots' paths on top."""
        run = self.run
        section = Section("Gas and paths of the robots", "plume")
        spacing = max(run.scenario.duration + run.scenario.warm_up, 1e-3) / MOST_FRAMES
        shown = self._tried(lambda: self._pictures(spacing), [])
        shown.sort(key=lambda picture: (picture.axes != "xy", not picture.name.startswith("gas")))
        trails = self._trails()
        for picture in shown:
            where = f", {picture.plane}" if picture.plane else ""
            kind = "logarithmic" if picture.colors == "log" else "linear"
            trailing = trails if picture.axes == "xy" else captions.ASIDE
            caption = captions.MEAN.format(
                count=picture.time.size,
                begin=float(picture.time[0]),
                end=float(picture.time[-1]),
                kind=kind,
                trails=trailing,
            )
            png = figures.mean_plume(run, picture, self.tracks)
            section.image(png, f"Mean {picture.quantity}{where}", caption)
        if not shown:
            section.lines.append(captions.NO_PICTURES)
            if self.tracks:
                section.image(figures.only_tracks(run, self.tracks), "Tracks", trails)
        return section

    def _pictures(self, spacing: float) -> "list[DataArray]":
        """Return pictures of the first plane of each kind; the column of a quantity replaces its slice."""
        if not has_pictures(self.run):
            return []
        names = [name for name in picture_names(self.run) if name.count("_") == 1]
        names = [
            name for name in names if name.replace("slice", "column") not in names or "slice" not in name
        ]
        found = pictures(self.run, names, (0.0, inf), spacing)
        return [found[name] for name in names if found.time.size]

    def _trails(self) -> str:
        if not self.tracks:
            return ""
        total = sum(group.count * group.trials for group in self.run.scenario.robots)
        shown = len(self.tracks)
        part = f" Shown are {shown} of {total:,} robots: those of the first trial." if shown < total else ""
        declared = any(track.values["declarations"].any() for track in self.tracks)
        return captions.TRAILS.format(part=(captions.DECLARED if declared else "") + part)

    def smelt(self) -> Section:
        """Return the report's section with a plot of sensor readings and algorithm states over time."""
        section = Section("Sensor readings and behaviour", "smelt")
        if self.tracks and max(len(track.t) for track in self.tracks) > 1:
            some = min(len(self.tracks), figures.MOST_SERIES)
            lanes = min(len(self.tracks), figures.MOST_LANES)
            part = ""
            if some < len(self.tracks):
                part = f" The readings are of the first {some} robots, the lanes of the first {lanes}."
            png = figures.smelt(self.run, self.tracks)
            section.image(png, "Readings and behaviour over time", captions.SMELT.format(part=part))
            decided = figures.decisions(self.tracks)
            if decided:
                section.image(decided, "Decision quantities over time", captions.DECISIONS)
        return section

    def maps(self) -> Section:
        """Return the report's section with gas maps beside the true gas, and the scores of the maps."""
        section = Section("Maps beside the truth", "maps")
        if not self.run.scenario.maps:
            return section
        most = maps.MOST
        made = self._tried(lambda: maps.maps_of(self.run.folder), [])
        if made:
            of_gas = [each for each in made if not each.is_of_wind]
            of_wind = [each for each in made if each.is_of_wind]
            for some, title, caption in (
                (of_gas, "Maps at the end", captions.MAPS),
                (of_wind, "Maps of the wind at the end", captions.WIND_MAPS),
            ):
                if some:
                    groups = list(dict.fromkeys(each.group for each in some))
                    part = f" Shown are the first {most} of {len(groups)} maps." if len(groups) > most else ""
                    shown = [each for each in some if each.group in groups[:most]]
                    image = maps.beside_truth(self.run, shown)
                    section.image(image, title, caption.format(part=part))
        else:
            section.lines.append(captions.NO_MAPS)
        results = self.result.get("maps", [])
        if results:
            section.table(facts.map_rows(results), captions.MAP_HEADS, captions.MAP_SCORES)
            section.table(facts.wind_rows(results), captions.WIND_HEADS, captions.WIND_SCORES)
            for titles, caption in (
                (captions.GAS_TITLES, captions.OVER_TIME),
                (captions.WIND_TITLES, captions.WIND_SCORES),
            ):
                over_time = figures.scores(results[:most], summary.map_names(results)[:most], titles)
                if over_time:
                    section.image(over_time, "Scores over time", caption)
        return section

    def beliefs(self) -> Section:
        """Return the report's section with belief maps of the source position, and the scores of the beliefs."""
        section = Section("Beliefs about the source's position", "beliefs")
        results = self.result.get("beliefs", [])
        made = self._tried(lambda: maps.beliefs_of(self.run.folder), []) if results else []
        if made:
            image = maps.beside_sources(self.run, made[: maps.MOST])
            section.image(image, "Beliefs at the end", captions.BELIEFS)
        heads = ("group", "peak to source [m]", "mean to source [m]", "expected distance [m]")
        heads += ("entropy [bit]", "probability within reach")
        section.table(maps.belief_rows(results), heads, captions.BELIEF_SCORES)
        heads = ("group", "robot", "estimated source (x, y) [m]", "spread [m]")
        heads += ("rate [mg/s]", "90 % interval", "probability")
        section.table(maps.source_rows(results), heads, captions.ESTIMATED_SOURCES)
        return section

    def balance(self) -> Section:
        """Return the report's section with the mass balance of the gas, and the quality of the flow solution."""
        section = Section("Gas budget and numerics", "balance")
        section.table(summary.budget(self.result), ("gas", "mass"), captions.BUDGET)
        section.table(summary.flow(self.result), ("air", "value", "meaning"))
        if self.result and section.empty:
            section.lines.append("This kind of wind and gas keeps no budget.")
        return section

    def notes(self) -> Section:
        """Return the report's section with the run's warnings, and notes on data that could not be read."""
        remarks = self.run.result.get("remarks")
        lines = [text for text in remarks if isinstance(text, str)] if isinstance(remarks, list) else []
        return Section("Notes", "notes", lines=lines + self.lacks)

    def citing(self) -> Section:
        """Return the report's section on citing: version of the software, and papers behind the models used."""
        version = self.run.result.get("version", "of unknown version")
        section = Section("How to cite", "citing")
        section.lines.append(captions.CITE.format(version=version))
        section.table(papers(self.run.scenario), ("used here", "rests on"))
        return section

    def again(self) -> Section:
        """Return the report's section on repeating the run: the command, and a table of the run's files."""
        section = Section("How to run it again", "again", code=True)
        section.lines += filter(None, self.run.header[:1])
        section.table(facts.files(self.run), ("file", "size", "contents"))
        return section
