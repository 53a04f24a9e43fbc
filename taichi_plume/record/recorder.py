"""The run as a rerun recording: gas, wind, robots, sensors, maps, events.

Fields are logged picture by picture; robots are gathered and sent once per simulated second. Of several
trials the first is recorded. The file can be read up to the last flush even when the process dies.
Only this module, `scene` and `layout` know rerun.
"""

import ctypes
import errno
import os
import re
from dataclasses import dataclass, field
from datetime import timedelta
from math import ceil, hypot
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from taichi_plume import __version__
from taichi_plume.files import disk
from taichi_plume.grid import fields
from taichi_plume.map_scores import MapScores
from taichi_plume.record import drawing, layout, scene
from taichi_plume.record.layout import TIME
from taichi_plume.scenario.obstacles import motion_of
from taichi_plume.scenario.openings import MovingWall
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.winds import ImportedWind, PlaybackWind, PlumeSimWind, SyntheticWind, UniformWind
from taichi_plume.simulation import Every, Simulation

MOST_ROBOTS = 50
MOST_PIXELS = 400  # per axis of the slice
MOST_VOXELS = 96  # per axis of the volume
SAMPLE_PERIOD = 0.1  # s, robots
FLUSH_TIMEOUT = 60.0  # s


@dataclass
class Robot:
    """A recorded robot, and what was sampled of it since the last flush."""

    index: int
    """In the swarm."""
    name: str
    color: tuple[int, ...]
    states: tuple[str, ...]
    """Names of the algorithm's states, and "found" at the end."""
    state: int = -1
    samples: list[tuple[float, ...]] = field(default_factory=list)
    """(time, x, y, heading, reading, believed x, y and heading) each."""
    changes: list[tuple[float, str]] = field(default_factory=list)
    last: dict[str, np.ndarray] = field(default_factory=dict)
    """Where each of its trails ends."""
    reckons: bool = False
    """Whether it has but its odometry to know where it is."""


class Recorder:
    """Writes `path` while `sim` runs. Add `observers()` to the simulation's; call `close()` whatever happens.

    Raises OSError, from the constructor or an observer, as soon as the disk has no room for more.
    """

    def __init__(
        self, sim: Simulation, path: Path, backend: str = "cpu", map_scores: MapScores | None = None
    ):
        self.path = Path(path)
        scenario = sim.scenario
        self.rates = scenario.recording
        self.stage = scene.Stage.of(sim)
        self.robots = _recorded_robots(sim)
        algorithms = [group.algorithm for group in scenario.robots]
        self.thresholds = sorted({a.threshold_ppm for a in algorithms if hasattr(a, "threshold_ppm")})
        self.events: list[tuple[float, str, str, int]] = []
        self.schedule = _schedule(scenario)
        self.walks: dict[int, list[tuple[float, float, float]]] = {
            n: [] for n, one in enumerate(scenario.obstacles) if motion_of(one)
        }
        """(time, x, y) of the way of each moving obstacle since the last flush."""
        self.maps: list[Any] = list(sim.maps)
        scores = map_scores or MapScores(sim)
        self.own_scores = None if map_scores else scores
        self.map_series = scores.series
        self.sent = [{"forecast": 0, "rows": 0} for _ in self.maps]
        """Of each map's errors and scores."""
        self.good_size = self.largest_batch = 0  # bytes
        self.open = True
        disk.require_room(self.path)
        batches = rr.ChunkBatcherConfig.DEFAULT()
        batches.flush_tick = timedelta(days=1)  # chunks are cut by `flush` alone: equal runs, equal chunks
        batches.flush_num_bytes = 1 << 22
        self.stream = rr.RecordingStream(
            "taichi_plume", recording_id=f"{scenario.name}-{scenario.seed}", batcher_config=batches
        )
        ghosts = [robot.name for robot in self.robots if robot.reckons]
        blueprint = layout.blueprint(sim, self.stage, [robot.name for robot in self.robots], ghosts)
        try:
            self.stream.save(self.path, default_blueprint=blueprint)
        except RuntimeError as error:
            self._abandon()
            raise OSError(errno.EIO, str(error), str(self.path)) from None
        self.stream.set_log_time_enabled(False)
        self.stream.send_recording_name(scenario.name)
        properties = rr.AnyValues(
            seed=scenario.seed, backend=backend, version=__version__, spacing_m=sim.grid.dx
        )
        self.stream.send_property("run", properties)
        self._log(scene.arena(sim, self.stage))
        self._log(scene.legends(sim, self.stage))
        self._log(scene.about(sim, backend, len(self.robots)))
        self._log(self._styles(sim))
        self._set_up_pictures(sim)

    def observers(self) -> list[Every]:
        """What the simulation has to call, in this order."""
        return [
            Every(1 / self.rates.rate, self.picture_gas, warm_up=True),
            Every(1 / self.rates.wind_rate, self.picture_wind, warm_up=True),
            Every(SAMPLE_PERIOD, self.sample_robots),
            Every(SAMPLE_PERIOD, self.sample_obstacles, warm_up=True),
            *([self.own_scores.observer()] if self.own_scores else []),
            Every(1.0, self.picture_maps),
            Every(1.0, self.flush, warm_up=True),
        ]

    def _log(self, entities: scene.Entities) -> None:
        """Log what never changes."""
        for entity, what in entities:
            self.stream.log(entity, what, static=True)

    def _styles(self, sim: Simulation) -> scene.Entities:
        """Bodies, and colours of trails, series and lanes."""
        for robot in self.robots:
            model = next(g.model for g in reversed(sim.swarm.groups) if robot.index >= g.start)
            yield (
                f"robots/{robot.name}",
                scene.body(model.body.radius, model.body.height, robot.color, self.stage),
            )
            trail = rr.LineStrips3D.from_fields(colors=robot.color, radii=rr.Radius.ui_points(1.8))
            yield f"trails/{robot.name}", trail
            if robot.reckons:
                pale = drawing.pale(robot.color)
                yield f"believed/{robot.name}", scene.ghost(model.body.radius, pale, self.stage)
                trail = rr.LineStrips3D.from_fields(colors=pale, radii=rr.Radius.ui_points(1.0))
                yield f"believed_trails/{robot.name}", trail
            yield f"sensors/{robot.name}", rr.SeriesLines(colors=robot.color, names=robot.name, widths=1.6)
            yield f"states/{robot.name}", scene.lanes(robot.states)
        for threshold in self.thresholds:
            line = rr.SeriesLines(colors=[200, 200, 200], names=f"threshold {threshold:g} ppm", widths=1.0)
            yield _threshold(threshold), line
        for n, model in enumerate(sim.scenario.maps):
            color = drawing.ROBOTS[n % len(drawing.ROBOTS)]
            faint = (color * 0.6).astype(np.uint8)
            name = model.kind.replace("_", " ")
            yield f"map_errors/{n}_mae", rr.SeriesLines(colors=color, names=f"{name}: error", widths=2.0)
            faint_line = rr.SeriesLines(colors=faint, names=f"{name}: forecast", widths=1.4)
            yield f"map_errors/{n}_forecast", faint_line
            for origin in layout.MAP_SERIES:
                if origin != "map_errors":
                    yield f"{origin}/{n}", rr.SeriesLines(colors=color, names=name, widths=2.0)

    def _set_up_pictures(self, sim: Simulation) -> None:
        """Where gas and wind are sampled, and what never changes in their pictures."""
        grid, recording = sim.grid, sim.scenario.recording
        pixel = grid.dx * ceil(max(grid.shape[:2]) / MOST_PIXELS)
        self.pixels = tuple(max(1, round(length / pixel)) for length in grid.extent[:2])
        self.slice_points = drawing.lattice([n * pixel for n in self.pixels], self.pixels)
        if grid.dim == 3:
            height = np.full((*self.pixels, 1), min(recording.slice_height, grid.extent[2]))
            self.slice_points = np.concatenate([self.slice_points, height], axis=-1)
        picture = rr.GridMap.from_fields(
            format=scene.picture_format(*self.pixels, color=False),
            cell_size=pixel,
            translation=[0, 0, self.stage.lift],
            colormap="inferno",
            opacity=0.95,
        )
        self._log(iter([("gas/slice", picture)]))
        self.volume_points = None
        if grid.dim == 3 and recording.volume:
            counts = [min(ceil(n / 2), MOST_VOXELS) for n in grid.shape]
            self.volume_points = drawing.lattice(grid.extent, counts)
            self.voxel = [length / n for length, n in zip(grid.extent, counts, strict=True)]
        height = min(recording.slice_height, grid.extent[-1])
        self.arrow_points, self.arrow_step = drawing.arrow_places(grid.extent, height)
        self.top_speed = _top_speed(sim)
        for n, gas_map in enumerate(self.maps):
            shape = np.shape(gas_map.estimate())[1:]
            for name in scene.ESTIMATES:
                blank = rr.GridMap.from_fields(
                    format=scene.picture_format(*shape, color=True),
                    cell_size=gas_map.cell,
                    translation=[0, 0, self.stage.lift],
                )
                self._log(iter([(f"maps/{n}/{name}", blank)]))

    # ------------------------------------------------------------ while it runs

    def picture_gas(self, sim: Simulation) -> None:
        """The slice above the floor and, in 3-D, the volume."""
        self.stream.set_time(TIME, duration=sim.t)
        places = self._gas(sim, self.slice_points)
        image = (255 * places).round().astype(np.uint8)
        self.stream.log("gas/slice", rr.GridMap.from_fields(data=drawing.rows(image)))
        if self.volume_points is not None:
            values = (self._gas(sim, self.volume_points) * 255).round() / 255  # fewer values pack better
            volume = rr.Volume3D(
                np.ascontiguousarray(values.transpose(2, 1, 0), np.float16),
                voxel_size=self.voxel,
                value_range=[0.0, 1.0],
                gamma=2.0,
                optical_density=3.0 / self.stage.height,
                colormap="inferno",
            )
            self.stream.log("gas/volume", volume)

    def _gas(self, sim: Simulation, points: np.ndarray) -> np.ndarray:
        """Place on the colour scale of the gas at some points."""
        ppm = fields.ppm_at(sim.gas, points, sim.t).sum(axis=-1)
        return np.nan_to_num(drawing.logarithmic(ppm, *self.rates.range_ppm))

    def picture_wind(self, sim: Simulation) -> None:
        """Arrows centred on their points."""
        velocity = fields.velocity_at(sim.wind, self.arrow_points, sim.t)
        speed = np.linalg.norm(velocity, axis=-1)
        share = np.sqrt(np.minimum(speed / self.top_speed, 1.0))
        seen = (share > 0.05) & np.isfinite(speed)
        direction = velocity[seen] / speed[seen, None]
        vectors = np.zeros((seen.sum(), 3))
        origins = np.full((seen.sum(), 3), 6 * self.stage.lift)
        vectors[:, : velocity.shape[1]] = direction * (0.95 * self.arrow_step * share[seen])[:, None]
        origins[:, : velocity.shape[1]] = self.arrow_points[seen]
        alpha = 60 + 150 * share[seen]
        colors = np.column_stack([np.full((len(alpha), 3), 230), alpha]).astype(np.uint8)
        self.stream.set_time(TIME, duration=sim.t)
        arrows = rr.Arrows3D(
            origins=origins - vectors / 2, vectors=vectors, colors=colors, radii=0.055 * self.arrow_step
        )
        self.stream.log("wind", arrows)

    def sample_robots(self, sim: Simulation) -> None:
        """Gather poses, readings and changes of state."""
        if not self.robots:
            return
        now = sim.swarm.snapshot()
        for n, robot in enumerate(self.robots):
            k = robot.index
            x, y = (float(v) for v in now["position"][k])
            reading = float(now["reading_ppm"][k])
            believed = (*(float(v) for v in now["believed_position"][k]), float(now["believed_heading"][k]))
            robot.samples.append((sim.t, x, y, float(now["heading"][k]), reading, *believed))
            state = len(robot.states) - 1 if now["found"][k] else int(now["state"][k])
            if state != robot.state:
                name = robot.states[state]
                robot.changes.append((sim.t, name))
                place = f"at ({x:.2f}, {y:.2f}) m"
                if now["found"][k]:
                    text = f"{robot.name} found a source {place}, {now['path_length'][k]:.2f} m driven"
                    self.events.append((sim.t, "FOUND", text, n))
                elif robot.state >= 0:
                    text = f"{robot.name}: {robot.states[robot.state]} -> {name} {place}, {reading:.3g} ppm"
                    self.events.append((sim.t, "STATE", text, n))
                robot.state = state

    def sample_obstacles(self, sim: Simulation) -> None:
        """Gather where those that move are, relative to their centre in the scenario."""
        for n, samples in self.walks.items():
            one = sim.scenario.obstacles[n]
            x, y = motion_of(one).place(one.center, sim.t)
            samples.append((sim.t, x - one.center[0], y - one.center[1]))

    def picture_maps(self, sim: Simulation) -> None:
        """Estimate, weight, truth and error of the first trial's maps, and their scores as series."""
        self.stream.set_time(TIME, duration=sim.t)
        for n, gas_map in enumerate(self.maps):
            estimate = np.asarray(gas_map.estimate())[0]
            weight = np.asarray(gas_map.weight(), float)[0]
            truth = self.map_series[n].truth
            low, high = self.rates.range_ppm
            ratio = np.maximum(estimate, low) / np.maximum(truth, low)
            places = {
                "estimate": drawing.logarithmic(estimate, low, high),
                "truth": drawing.logarithmic(truth, low, high),
                "weight": drawing.logarithmic(np.where(weight > 0, weight, np.nan), *scene.WEIGHTS),
                "error": drawing.logarithmic(ratio, *scene.RATIOS),
            }
            for name, palette in scene.ESTIMATES.items():
                pixels = drawing.rows(drawing.painted(places[name], palette))
                self.stream.log(f"maps/{n}/{name}", rr.GridMap.from_fields(data=pixels))
            self._send_scores(n)

    def _send_scores(self, n: int) -> None:
        """What is new of a map's scores."""
        series, sent = self.map_series[n], self.sent[n]
        forecasts = self.maps[n].errors
        fresh = forecasts[sent["forecast"] :]
        self._send_series(f"map_errors/{n}_forecast", [t for t, _ in fresh], [error for _, error in fresh])
        times = series.time[sent["rows"] :]
        for name, entity in zip(
            layout.MAP_SERIES.values(), (f"map_errors/{n}_mae", *_numbered(n)), strict=True
        ):
            self._send_series(entity, times, series.values[name][sent["rows"] :])
        sent["forecast"], sent["rows"] = len(forecasts), len(series.time)

    def _send_series(self, entity: str, times: list[float], values: list[np.ndarray]) -> None:
        """The first trial's values that are numbers."""
        known = [
            (t, float(value[0])) for t, value in zip(times, values, strict=True) if np.isfinite(value[0])
        ]
        if known:
            t, scalars = zip(*known, strict=True)
            self.stream.send_columns(entity, [_times(t)], rr.Scalars.columns(scalars=scalars))

    def flush(self, sim: Simulation) -> None:
        """Send what was gathered and bring it to the disk. Raises OSError when there is no room."""
        while self.schedule and self.schedule[0][0] <= sim.t + 1e-9:
            at, text = self.schedule.pop(0)
            self.events.append((at, "WIND", text, -1))
        disk.require_room(self.path, 4 * self.largest_batch)
        self._send()

    def _send(self) -> None:
        for robot in self.robots:
            self._send_robot(robot)
        for n, samples in self.walks.items():
            if samples:
                t, x, y = np.array(samples).T
                samples.clear()
                shift = rr.Transform3D.columns(translation=np.column_stack([x, y, 0 * t]))
                self.stream.send_columns(f"world/obstacles/{n}", [_times(t)], shift)
        if self.events:
            times, levels, texts, robots = zip(*sorted(self.events), strict=True)
            colors = [_packed(scene.TEXT if n < 0 else self.robots[n].color) for n in robots]
            columns = rr.TextLog.columns(text=texts, level=levels, color=colors)
            self.stream.send_columns("events", [_times(times)], columns)
            self.events.clear()
        try:
            self.stream.flush(timeout_sec=FLUSH_TIMEOUT)
        except RuntimeError as error:
            self._abandon()
            disk.require_room(self.path)
            raise OSError(errno.EIO, f"writing failed ({error})", str(self.path)) from None
        size = self.path.stat().st_size
        self.largest_batch = max(self.largest_batch, size - self.good_size)
        self.good_size = size

    def _send_robot(self, robot: Robot) -> None:
        if robot.changes:
            times, states = zip(*robot.changes, strict=True)
            self.stream.send_columns(
                f"states/{robot.name}", [_times(times)], rr.StateChange.columns(state=states)
            )
            robot.changes.clear()
        if not robot.samples:
            return
        columns = np.array(robot.samples).T
        t, reading = columns[0], columns[4]
        robot.samples.clear()
        time = [_times(t)]
        self._send_way(robot, "robots", "trails", time, columns[1:4])
        if robot.reckons:
            self._send_way(robot, "believed", "believed_trails", time, columns[5:8])
        self.stream.send_columns(f"sensors/{robot.name}", time, rr.Scalars.columns(scalars=reading))
        if robot is self.robots[0]:
            for threshold in self.thresholds:
                level = rr.Scalars.columns(scalars=np.full(len(t), threshold))
                self.stream.send_columns(_threshold(threshold), time, level)

    def _send_way(self, robot: Robot, poses: str, trails: str, time: list, way: np.ndarray) -> None:
        """Poses (3, n), and the steps between them as a trail, to the robot's entities below these two."""
        x, y, heading = way
        place = np.column_stack([x, y, np.full(len(x), 2 * self.stage.lift)])
        turn = np.column_stack([0 * x, 0 * x, np.sin(heading / 2), np.cos(heading / 2)])
        pose = rr.Transform3D.columns(translation=place, quaternion=turn)
        self.stream.send_columns(f"{poses}/{robot.name}", time, pose)
        path = np.vstack([robot.last.get(trails, place[:1]), place])
        robot.last[trails] = place[-1:]
        steps = rr.LineStrips3D.columns(strips=list(np.stack([path[:-1], path[1:]], axis=1)))
        self.stream.send_columns(f"{trails}/{robot.name}", time, steps)

    def close(self) -> None:
        """Send the rest and finish the file; it stays readable whatever happened before."""
        if not self.open:
            return
        try:
            self._send()
        finally:
            if self.open:
                self.stream.disconnect()
                self.open = False

    def _abandon(self) -> None:
        """Give up after a failed write. Rerun would now hang in `disconnect` and when the stream is freed."""
        rr.unregister_shutdown()
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self.stream.to_native()))
        self.open = False
        if self.path.exists():
            os.truncate(self.path, self.good_size)  # to the last whole message


# ---------------------------------------------------------------- what is recorded


def _recorded_robots(sim: Simulation) -> list[Robot]:
    """The first trial's robots, at most MOST_ROBOTS, the groups in equal shares."""
    groups = list(sim.swarm.groups)
    share = max(1, MOST_ROBOTS // max(1, len(groups)))
    robots = []
    for group, names in zip(groups, sim.state_names(), strict=True):
        part = _part(group.name)
        if sum(_part(other.name) == part for other in groups) > 1:
            part = f"{part}{groups.index(group)}"
        states = (*names, "found")
        for i in range(min(group.count, share)):
            name = part if group.count == 1 else f"{part}-{i}"
            color = tuple(int(v) for v in drawing.ROBOTS[len(robots) % len(drawing.ROBOTS)])
            reckons = group.model.odometry is not None
            robots.append(Robot(group.start + i, name, color, states, reckons=reckons))
    return robots[:MOST_ROBOTS]


def _schedule(scenario: Scenario) -> list[tuple[float, str]]:
    """(time, text) of each scheduled change of an opening's speed, in order."""
    changes = []
    for n, opening in enumerate(getattr(scenario.wind, "openings", ())):
        for step in getattr(opening, "schedule", ()):
            text = f"{opening.kind} {n} on face {opening.face}: {step.speed:g} m/s from now on"
            changes.append((step.at, text))
    return sorted(changes)


def _top_speed(sim: Simulation) -> float:
    """Largest prescribed or recorded speed [m/s]: the arrows' full length."""
    wind = sim.scenario.wind
    if isinstance(wind, PlaybackWind | PlumeSimWind | ImportedWind):
        return getattr(sim.wind, "top_speed", 0.0) or 0.1
    speeds = [hypot(*wind.velocity)] if isinstance(wind, UniformWind) else []
    if isinstance(wind, SyntheticWind):
        speeds.append(2.0 * hypot(wind.speed, wind.circulation))  # faster in one place of ten thousand only
    for opening in getattr(wind, "openings", ()):
        if isinstance(opening, MovingWall):
            speeds.append(hypot(*opening.velocity))
        speeds.append(abs(getattr(opening, "speed", None) or 0.0))
        if getattr(opening, "curve", None):
            domain = sim.scenario.domain
            speeds.append(opening.curve.flow / opening.area(domain.extent, domain.depth))
        speeds += [abs(step.speed) for step in getattr(opening, "schedule", ())]
    return max(speeds, default=0.0) or 0.1


# ---------------------------------------------------------------- small conversions to rerun


def _times(t: Any) -> rr.TimeColumn:
    return rr.TimeColumn(TIME, duration=t)


def _numbered(n: int) -> list[str]:
    """Entities of the scores of map n other than its error."""
    return [f"{origin}/{n}" for origin in layout.MAP_SERIES if origin != "map_errors"]


def _part(name: str) -> str:
    """A name as a part of an entity path."""
    return re.sub(r"[^A-Za-z0-9_.-]", "_", name) or "_"


def _threshold(ppm: float) -> str:
    return "sensors/threshold_" + _part(f"{ppm:g}")


def _packed(color: tuple[int, ...]) -> np.uint32:
    r, g, b = color
    return np.uint32(r << 24 | g << 16 | b << 8 | 255)
