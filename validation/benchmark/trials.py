"""Wall time of many trials of the SPIRAL search algorithm in a recorded room."""

import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from taichi_plume.assembly.assemble import assemble
from taichi_plume.engine import program
from taichi_plume.execution.film_output import Filming
from taichi_plume.validation.searches import outcomes, scenario_of
from taichi_plume.validation.spiral_room import HOUR, at, momo, room

RECORDED = 600.0  # s, played in a loop
FILM = "room.zarr"


@dataclass(frozen=True)
class Trials:
    """Cost of many search trials run to their end, and of recording the room."""

    case: str
    trials: int
    success: float
    mean_s: float
    robot_steps: float
    recording_wall_s: float
    wall_s: float

    def __str__(self) -> str:
        return (
            f"{self.case:16} {self.trials:8,} trials in {self.wall_s:.0f} s ({self.robot_steps / 1e6:.0f} million "
            f"robot-steps; {self.success:.1%} found in {self.mean_s:.0f} s), recorded in {self.recording_wall_s:.0f} s"
        )


def spiral_trials(
    case: str, arch: str, trials: int = 10_000, recorded: float = RECORDED, limit: float = HOUR
) -> list[Trials]:
    """Run SPIRAL from 180 cm until all robots have found the dish or `limit` [s] is over; return the cost."""
    with TemporaryDirectory() as folder:
        begin = time.perf_counter()
        program.start(arch)
        fields = {"rate": 1.0, "quantities": ["wind", "gas"]}
        sim = assemble(scenario_of(room(0, [], recorded) | {"fields": fields}))
        assert sim.scenario.fields is not None
        film = Filming(sim, Path(folder) / FILM, sim.scenario.fields)
        film.start()
        sim.observers.append(film.observer())
        sim.run()
        middle = time.perf_counter()
        program.start(arch)
        both = {"kind": "playback", "file": FILM, "loop": True}
        group = momo("SPIRAL", trials, at(180), {"kind": "spiral", "minimum_ppm": 6.0})
        played = room(0, [group], limit) | {"warm_up": 0.0, "wind": both, "gas": both}
        sim = assemble(scenario_of(played, Path(folder)), Path(folder))
        sim.run()
        end = time.perf_counter()
    columns = outcomes(sim)["SPIRAL"]
    good = [t for t, success in zip(columns["time_s"], columns["success"], strict=True) if success]
    steps = sum(good) / sim.dt + (trials - len(good)) * sim.tick
    mean = sum(good) / max(1, len(good))
    return [Trials(case, trials, len(good) / trials, mean, steps, middle - begin, end - middle)]
