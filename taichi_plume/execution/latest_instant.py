"""Latest instant of a running simulation in one small file, for a program that shows the run while it goes on.

The file holds the pictures of all scalars and the wind on the horizontal planes of the recording, robots, readings and
progress. It is replaced about twice a second of wall-clock time; `read` returns its content.
"""

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np

from taichi_plume.execution.progress import phase
from taichi_plume.files.disk import written_whole
from taichi_plume.guard.safe_open import open_regular
from taichi_plume.observed.observer import Observer
from taichi_plume.observed.scales import Scale
from taichi_plume.observed.views import View, layout, views
from taichi_plume.time_loop import TimeLoop

PERIOD = 0.5  # s of wall-clock time between updates
SAMPLES = 1000  # of the readings, in a run
MOST_ROBOTS = 12  # whose readings are noted
WIND = "wind_"  # before the names of planes, in the file
FIRST = "slice"  # the first horizontal plane, in 2-D the only one


class Picture(NamedTuple):
    """Values of a quantity, (ny, nx), NaN without air; cell: width of a pixel [m]; scale: of the colours.

    quantity: with the height in 3-D, such as "ethanol · 0.3 m above the floor"; plane: its name in the recording.
    """

    quantity: str
    unit: str
    scale: Scale
    cell: float
    values: np.ndarray
    plane: str = FIRST

    @classmethod
    def of(cls, about: Mapping[str, Any], values: np.ndarray) -> "Picture":
        """Return the picture of a view. about: attributes of the view's variable; see `observed.views.layout`."""
        quantity = " · ".join(filter(None, (about["quantity"], about["plane"])))
        return cls(quantity, about["units"], Scale.of(about), about["cell"][0], values, about["view"])


class Instant(NamedTuple):
    """State of a run at one instant. t: simulated time [s]; end: of the run; done: completed fraction.

    speed: simulated over wall-clock time; phase: "compiling", "warm-up" or "running". winds: (x, y, u, v) of arrows,
    (4, n), by the name of the horizontal plane; robots: (x, y, heading) of the first trial, (3, robots); readings: time
    [s] and the readings [ppm] of these robots since the start, (samples, 1 + robots). pictures: by name, such as
    "gas_slice", the sum of the gases first.
    trails: positions of each robot at the times of the readings until t, (2, n) [m].
    """

    t: float
    end: float
    done: float
    speed: float
    phase: str
    winds: Mapping[str, np.ndarray]
    robots: np.ndarray
    readings: np.ndarray
    pictures: dict[str, Picture]
    trails: Sequence[np.ndarray] = ()

    def wind(self, picture: Picture | None = None) -> np.ndarray:
        """Return the arrows (4, n) on the plane of a picture; of a maximum over the height, on the first slice."""
        plane = picture.plane if picture is not None else FIRST
        return self.winds.get(FIRST if plane == "column" else plane, np.empty((4, 0)))


class InstantFile:
    """Writer of the latest instant of a simulation to an NPZ file; failures to write are ignored."""

    def __init__(self, sim: TimeLoop, path: Path):
        self.path, self.written = path, -PERIOD
        self.begun, self.first = time.monotonic(), sim.tick
        self.observer = Observer(sim, [view for view in views(sim) if view.plane.letters == "xy"])
        scalars = [view for view in self.observer.views if not view.quantity.components]
        self.winds = [view for view in self.observer.views if view.quantity.components]
        self.variables = layout(scalars, self.observer.samples).variables
        groups = sim.swarm.groups if sim.swarm.count else []
        self.robots = np.concatenate(
            [np.arange(group.count * group.trials) < group.count for group in groups] or [np.empty(0, bool)]
        )
        self.readings: list[np.ndarray] = []
        self.places: list[np.ndarray] = []
        self.every = max(1, (sim.last_tick - sim.tick) // SAMPLES)

    def update(self, sim: TimeLoop) -> None:
        """Note the readings, and replace the file unless it has just been written."""
        if sim.swarm.count and sim.tick >= 0 and sim.tick % self.every == 0:
            state = sim.swarm.snapshot()
            readings = state["reading_ppm"][self.robots][:MOST_ROBOTS]
            self.readings.append(np.concatenate([[sim.t], readings]))
            self.places.append(state["position"][self.robots, :2].astype(np.float32))
        now = time.monotonic()
        if now >= self.written + PERIOD or sim.finished:
            self.written = now
            self._write({name: np.asarray(of) for name, of in self._content(sim, now).items()})

    def _content(self, sim: TimeLoop, now: float) -> dict[str, Any]:
        pictures = self.observer.observe(sim)
        robots = np.empty((3, 0))
        if sim.swarm.count:
            state = sim.swarm.snapshot()
            robots = np.stack([*state["position"][:, :2].T, state["heading"]])[:, self.robots]
        first, last = sim.scenario.first_tick, sim.last_tick
        return {
            "t": sim.t,
            "end": sim.scenario.duration,
            "done": (sim.tick - first) / max(1, last - first),
            "speed": (sim.tick - self.first) * sim.dt / max(now - self.begun, 1e-9),
            "phase": phase(sim),
            "robots": robots.astype(np.float32),
            "readings": np.array(self.readings or np.empty((0, 1)), np.float32),
            "places": np.array(self.places or np.empty((0, 0, 2)), np.float32),
            "pictures": json.dumps({each.name: each.attributes for each in self.variables}),
            **{each.name: each.values(pictures) for each in self.variables},
            **{f"{WIND}{view.plane.name}": self._arrows(view, pictures) for view in self.winds},
        }

    def _arrows(self, view: View, pictures: Mapping[str, np.ndarray]) -> np.ndarray:
        places = np.moveaxis(self.observer.samples[view.name].points[..., :2], -1, 0)
        return np.concatenate([places, pictures[view.name][:2]]).reshape(4, -1).astype(np.float32)

    def _write(self, content: dict[str, np.ndarray]) -> None:
        with (
            suppress(OSError),
            written_whole(self.path, durable=False) as fresh,
            fresh.open("wb") as file,
        ):
            np.savez(file, **content)  # pyright: ignore[reportArgumentType]


def read(path: Path) -> Instant | None:
    """Return the content of a file of `InstantFile`; None if there is none yet, or if it cannot be read."""
    try:
        with open_regular(path) as content, np.load(content, allow_pickle=False) as file:
            t, end, done, speed = (float(file[key]) for key in ("t", "end", "done", "speed"))
            robots, readings = file["robots"], file["readings"]
            winds = {name.removeprefix(WIND): file[name] for name in file.files if name.startswith(WIND)}
            pictures = {
                name: Picture.of(of, file[name]) for name, of in json.loads(str(file["pictures"])).items()
            }
            trails = list(np.moveaxis(file["places"], 0, -1))
            return Instant(t, end, done, speed, str(file["phase"]), winds, robots, readings, pictures, trails)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, BadZipFile):
        return None
