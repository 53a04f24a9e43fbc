"""Writer of `maps.zarr`: gas maps and source posteriors (beliefs) at the end of a run; see `files/maps_file.py`."""

from pathlib import Path

import numpy as np

from taichi_plume.files import disk, maps_file
from taichi_plume.files.film import BACKGROUND
from taichi_plume.scoring.beliefs import GroupBeliefs, beliefs
from taichi_plume.scoring.declarations import Json
from taichi_plume.scoring.maps import MapScores, MapSeries
from taichi_plume.time_loop import TimeLoop, Uncertain
from taichi_plume.version import __version__


class MapsFile:
    """Writer of `maps.zarr`. The gas maps are written only when the run ends, also after an error or interruption."""

    STATE = ()

    def __init__(self, sim: TimeLoop, path: Path, map_scores: MapScores):
        self.sim, self.path, self.map_scores = sim, path, map_scores
        self.open = False

    def start(self) -> None:
        disk.require_room(self.path)
        self.open = True

    def resume(self) -> None:
        """Prepare for a resumed run: remove the maps that the interrupted run wrote at its end."""
        disk.discard(self.path)
        self.start()

    def flush(self) -> None:
        pass

    def close(self) -> None:
        """Write the final gas maps and beliefs, all or none. Raises OSError if the disk is full."""
        if not self.open:
            return
        self.open = False
        scenario = self.sim.scenario
        found = beliefs(self.sim)
        series = self.map_scores.series
        facts = {
            "title": f"Gas maps of {scenario.name}",
            "source": f"taichi_plume {__version__}",
            **scenario.seeds,
            "maps": len(series),
            "beliefs": len(found),
        }
        parts = [(str(n), self._map_facts(n), _map_variables(scored)) for n, scored in enumerate(series)]
        parts += [(f"belief_{k}", self._belief_facts(group), _belief(group)) for k, group in enumerate(found)]
        maps_file.write(self.path, facts, parts)

    def _map_facts(self, n: int) -> Json:
        model, series = self.sim.scenario.maps[n], self.map_scores.series[n]
        rivals = len(series.parts) > 1
        names = [group.name for group in self.sim.swarm.groups] if self.sim.swarm.count else []
        made = [[names[k]] if rivals else names for k in range(len(series.parts))]
        backgrounds = {name: ppm for name, ppm in self.sim.scenario.backgrounds.items() if ppm}
        return {
            "title": f"Gas map {n} of {self.sim.scenario.name}",
            **({BACKGROUND: backgrounds} if backgrounds else {}),
            **model.model_dump(mode="json"),
            "t_s": self.sim.t,
            "groups": [
                {"names": who, "first_trial": rows.start, "trials": rows.stop - rows.start}
                for who, rows in zip(made, series.parts, strict=True)
            ],
        }

    def _belief_facts(self, belief: GroupBeliefs) -> Json:
        group = belief.group
        return {
            "title": f"Source posterior (belief) of {group.name}",
            "group": group.name,
            "algorithm": group.model.algorithm.kind,
            "cell_m": belief.cell,
            "t_s": self.sim.t,
        }


def _map_variables(series: MapSeries) -> dict[str, np.ndarray]:
    """Return the stored arrays of a gas or wind map by variable name: estimate, weight, truth, coordinates and more."""
    estimate = np.asarray(series.map.estimate(), np.float32)
    trials, nx, ny = estimate.shape[:3]
    wind, levels = series.quantity == "wind", series.levels
    cells = {"estimate": estimate, "weight": np.asarray(series.map.weight(), np.float32)}
    if isinstance(series.map, Uncertain):
        cells["variance"] = np.asarray(series.map.variance(), np.float32)
    cells["truth"] = np.broadcast_to(series.truth.astype(np.float32), estimate.shape)
    return {
        "trial": np.arange(trials, dtype=np.int32),
        **({"z": levels.middle} if levels else {}),
        "y": (np.arange(ny) + 0.5) * series.cell,
        "x": (np.arange(nx) + 0.5) * series.cell,
        **{
            name: np.ascontiguousarray(values.swapaxes(1, 3 if levels else 2))
            for name, values in cells.items()
        },
        **({"component": np.arange(2, dtype=np.int32)} if wind else {}),
        "measurable": series.measurable.T.astype(np.int8),
    }


def _belief(belief: GroupBeliefs) -> dict[str, np.ndarray]:
    """Return the stored arrays of a robot group's source posteriors by variable name, with their coordinates."""
    x, y = belief.axes()
    trials, robots = belief.p.shape[:2]
    return {
        "trial": np.arange(trials, dtype=np.int32),
        "robot": np.arange(robots, dtype=np.int32),
        "y": y,
        "x": x,
        "probability": np.ascontiguousarray(belief.p.transpose(0, 1, 3, 2), np.float32),
        **({} if belief.prior is None else {"prior": np.ascontiguousarray(belief.prior.T, np.float32)}),
    }
