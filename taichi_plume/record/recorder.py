"""Recorder: rerun recording of a run, with gas, wind, robots, sensors, maps and events.

Fields are logged picture by picture; robots are gathered and sent in batches. Of several trials the first is recorded.
The file is readable up to the last flush even if the process dies. Only the modules of this folder import rerun.
"""

import time
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from taichi_plume.observed import planes
from taichi_plume.observed.observer import Observer
from taichi_plume.observed.views import views
from taichi_plume.record import layout, legends, scene, text_document
from taichi_plume.record.map_pictures import BeliefPictures, MapPictures, WindMapArrows
from taichi_plume.record.pictures import Arrows, Pictures, recorded
from taichi_plume.record.placement import Stage
from taichi_plume.record.stream import Stream, mend
from taichi_plume.record.tracks import Event, Tracks, recorded_robots
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scoring.maps import MapScores
from taichi_plume.time_loop import Every, TimeLoop
from taichi_plume.version import __version__

SAMPLE_PERIOD = 0.1  # s, robots
LIVE = 0.5  # s of wall time between two batches for a viewer
BATCH = 5.0  # s, at least
BATCHES = 250  # at most: rerun keeps 1.5 kB per batch and entity in memory until the end
AT_ONCE = 10  # robots whose samples are sent together
EARLIER = "recording.old.rrd"
MENDED = "recording.part.rrd"


class Recorder:
    """Writer of `path` while `sim` runs. Add `observers()` to the simulation's; call `close()` in any case.

    `start()` begins the file, `resume()` continues the file of a resumed run. live: address of a viewer (see `live`).
    observer: of the run's views; by default one of its own.

    Raises OSError, from the constructor or an observer, as soon as the disk has too little room.
    """

    STATE = ("t", "share", "schedule", "shown", "tracks", "maps", "wind_maps", "arrows")

    def __init__(
        self,
        sim: TimeLoop,
        path: Path,
        backend: str = "cpu",
        map_scores: MapScores | None = None,
        live: str | None = None,
        observer: Observer | None = None,
    ):
        scenario = sim.scenario
        self.sim, self.path, self.t = sim, path, -np.inf
        robots = recorded_robots(sim)
        thresholds = {group.algorithm.threshold for group in scenario.robots}
        self.thresholds = sorted(ppm for ppm in thresholds if ppm is not None)
        self.events: list[Event] = []
        self.schedule = _schedule(scenario)
        self.walks: dict[int, list[tuple[float, float, float]]] = {
            n: [] for n, obstacle in enumerate(scenario.obstacles) if obstacle.motion
        }
        """(time, x, y) of each moving obstacle since the last flush."""
        changing = [n for n, (_, source) in enumerate(scenario.sources) if scene.changes(source)]
        self.shown: dict[int, list[float]] = {n: [] for n in changing}
        """Drawn place of each source that moves, appears or ends; empty while it is not there."""
        scores = map_scores or MapScores(sim)
        self.own_scores = None if map_scores else scores
        decisions = [each.name for each in sim.decision_columns()]
        self.stage = stage = Stage.of(sim.grid.extent)
        self.observer = observer or Observer(sim, views(sim))
        self.own_observers = [] if observer else self.observer.observers()
        seen = planes.planes(scenario, sim.grid.extent)
        shown = list(
            dict.fromkeys(view.quantity for view in recorded(self.observer) if not view.quantity.components)
        )
        blueprint = layout.Layout(sim, layout.Shown(stage, robots, seen, shown, live is not None)).blueprint()
        self.stream = Stream(path, scenario.name, list(scenario.seeds.values()), blueprint, live)
        self.sent = -np.inf  # wall time of the next batch for the viewer
        self.shares = max(1, ceil(len(robots) / AT_ONCE))
        self.share = 0  # number of the next share of the robots to send
        values: dict[str, Any] = {**scenario.seeds, "backend": backend, "version": __version__}
        self.stream.rerun.send_property("run", rr.AnyValues(**values, spacing_m=sim.grid.dx))
        self.stream.log_still(scene.arena(scenario, sim.obstacles, stage))
        for plane in seen:
            if plane.letters != "xy":
                self.stream.log_still(
                    scene.section(sim, planes.Raster(plane, sim.grid, sim.air.solid), stage)
                )
        self.stream.log_still(legends.legends(sim, stage, seen, shown))
        self.stream.log_still(text_document.about(sim, backend, len(robots), seen, shown))
        self.tracks = Tracks(self.stream, stage, robots, self.thresholds, self.events, decisions)
        self.arrows = Arrows(self.stream, stage, self.observer)
        self.observer.shown_by += [Pictures(self.stream, sim, stage, self.observer).show, self.arrows.show]
        self.maps = MapPictures(self.stream, sim, stage, scores.series)
        self.wind_maps = WindMapArrows(self.stream, sim, stage, scores.series)
        self.beliefs = BeliefPictures(self.stream, sim, stage)

    def observers(self) -> list[Every]:
        """Return the observers that the simulation has to call, in this order."""
        return [
            *self.own_observers,
            Every(SAMPLE_PERIOD, self.tracks.sample),
            Every(SAMPLE_PERIOD, self.sample_obstacles, warm_up=True),
            *([Every(SAMPLE_PERIOD, self.show_sources, warm_up=True)] if self.shown else []),
            *([self.own_scores.observer()] if self.own_scores else []),
            Every(1.0, self.maps.show),
            Every(1.0, self.wind_maps.show),
            Every(1.0, self.beliefs.show),
            Every(max(BATCH, self.sim.scenario.duration / BATCHES) / self.shares, self.note, warm_up=True),
            Every(1.0, lambda _: self.stream.require_room(), warm_up=True),
            *([Every(SAMPLE_PERIOD, self.show_now, warm_up=True)] if self.stream.live else []),
        ]

    def show_now(self, sim: TimeLoop) -> None:
        """Send the gathered samples to the viewer, twice per second of wall time."""
        if time.monotonic() - self.sent > LIVE:
            self.flush()
            self.sent = time.monotonic()

    def start(self) -> None:
        """Start writing the recording."""
        self.stream.begin()

    def resume(self) -> None:
        """Resume a recording: start the file with the earlier contents up to the last `flush`."""
        whole = self.path.with_name(EARLIER)
        if self.path.exists() and not whole.exists():  # otherwise this step was interrupted before
            fresh = self.path.with_name(MENDED)
            mend(self.path, fresh)
            fresh.replace(whole)
        self.stream.begin()
        if whole.exists():
            self.stream.take_over(whole, self.t)
            whole.unlink()

    def sample_obstacles(self, sim: TimeLoop) -> None:
        """Gather the positions of moving obstacles, relative to their centre in the scenario."""
        for n, samples in self.walks.items():
            obstacle = sim.scenario.obstacles[n]
            if obstacle.motion is not None:
                x, y = obstacle.motion.place(obstacle.center, sim.t)
                samples.append((sim.t, x - obstacle.center[0], y - obstacle.center[1]))

    def show_sources(self, sim: TimeLoop) -> None:
        """Draw the sources that move, appear or end at their present places, and clear those that are not there."""
        places = sim.scenario.sources_at(sim.t)
        for n, before in self.shown.items():
            place = [] if np.isnan(places[n]).any() else places[n].tolist()
            if place == before:
                continue
            if place:
                for entity, archetype in scene.source_ball(n, sim.scenario.sources[n][1], place, self.stage):
                    self.stream.log(sim.t, entity, archetype)
            else:
                self.stream.log(sim.t, f"world/sources/{n}", rr.Clear(recursive=True))
            self.shown[n] = place

    def note(self, sim: TimeLoop) -> None:
        """Log scheduled events and write the gathered samples; many robots take turns, as a run in real time has less
        than a tick for this. Raises OSError if there is no room.
        """
        while self.schedule and self.schedule[0][0] <= sim.t + 1e-9:
            at, text = self.schedule.pop(0)
            self.events.append((at, "WIND", text, scene.TEXT))
        self.stream.require_room()
        self._send(self.share, self.shares)
        self.share = (self.share + 1) % self.shares

    def flush(self) -> None:
        """Write the gathered samples to the disk. Raises OSError if there is no room."""
        self.stream.require_room()
        self._send()
        self.t = self.sim.t

    def _send(self, share: int = 0, of: int = 1) -> None:
        self.tracks.send(share, of)
        self.arrows.send()
        for n, samples in self.walks.items():
            if samples:
                t, x, y = np.array(samples).T
                samples.clear()
                shift = rr.Transform3D.columns(translation=np.column_stack([x, y, 0 * t]))
                self.stream.send(f"world/obstacles/{n}", t, shift)
        if self.events:
            times, levels, texts, colors = zip(*sorted(self.events), strict=True)
            packed = [_packed(color) for color in colors]
            self.stream.send("events", times, rr.TextLog.columns(text=texts, level=levels, color=packed))
            self.events.clear()
        self.stream.flush()

    def close(self) -> None:
        """Send the remaining samples and finish the recording, which stays readable in any case."""
        if not self.stream.open:
            return
        try:
            self._send()
        finally:
            self.stream.close()


def _schedule(scenario: Scenario) -> list[tuple[float, str]]:
    """Return the time and text of each scheduled change of an opening's speed, in order."""
    changes = []
    for n, opening in enumerate(scenario.openings):
        for step in opening.changes:
            face = opening.region.face if opening.region else ""
            text = f"{opening.kind} {n} on face {face}: {step.speed:g} m/s from now on"
            changes.append((step.at, text))
    return sorted(changes)


def _packed(color: tuple[int, ...]) -> np.uint32:
    r, g, b = color
    return np.uint32(r << 24 | g << 16 | b << 8 | 255)
