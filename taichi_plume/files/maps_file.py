"""`maps.zarr`: the maps of a run as they were at its end, in a zarr group that xarray opens.

Map number n of the scenario is the group "n", with the kind and parameters of the map and its time `t_s` [s] as
attributes. `groups` of these says whose readings made it: names, the first of their trials, and how many there are.
Variables are float32 in the order (trial, y, x), NaN where nothing is known:

    estimate    [ppm]   what the map says
    variance    [ppm²]  of the estimate; of maps that tell it
    weight      [1]     what stands behind the estimate, in the method's own measure
    truth       [ppm]   mean of the gas since the robots started, at the height of their sensors; of all trials the same
    measurable  1 where a robot could be; without trial

What group k of those that believe in places of the source believes is the group "belief_k", with the name of the group
and the kind of its algorithm as attributes:

    probability  [1]  of the cell, in the order (trial, robot, y, x); over the cells it sums to 1

To look at one: ``xarray.open_zarr("runs/arena-1/maps.zarr", group="0")``.
"""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from taichi_plume import __version__
from taichi_plume.files import disk, manifest
from taichi_plume.files.run_folder import RunFolderError

if TYPE_CHECKING:
    import xarray

    from taichi_plume.scoring.beliefs import GroupBeliefs
    from taichi_plume.scoring.maps import MapScores, MapSeries
    from taichi_plume.simulation import Simulation

FORMAT = "taichi_plume maps 1"
PART = "maps.part"  # what is being written
WHOLE = ("trial", "y", "x")
MEANING = {
    "trial": ("1", "number of the trial", ()),
    "y": ("m", "y of the cells' middles", ()),
    "x": ("m", "x of the cells' middles", ()),
    "estimate": ("ppm", "gas as the map says", WHOLE),
    "variance": ("ppm2", "variance of the estimate", WHOLE),
    "weight": ("1", "what stands behind the estimate, in the method's own measure", WHOLE),
    "truth": ("ppm", "mean of the gas since the robots started", WHOLE),
    "measurable": ("1", "1 where a robot could be", WHOLE[1:]),
    "robot": ("1", "number of the robot in its team", ()),
    "probability": ("1", "that the source is in the cell", ("trial", "robot", "y", "x")),
}


class MapsFile:
    """Writes `path` when the run ends, however it does; `go_on()` removes that of an earlier end."""

    STATE = ()

    def __init__(self, sim: "Simulation", path: Path, map_scores: "MapScores"):
        self.sim, self.path, self.map_scores = sim, path, map_scores
        self.open = False

    def start(self) -> None:
        disk.require_room(self.path)
        self.open = True

    def go_on(self) -> None:
        shutil.rmtree(self.path, ignore_errors=True)
        self.start()

    def flush(self) -> None:
        """Nothing is written before the end."""

    def close(self) -> None:
        """Write the maps, all or none. Raises OSError when the disk is full."""
        if not self.open:
            return
        self.open = False
        from taichi_plume.files import zarr_groups
        from taichi_plume.scoring.beliefs import beliefs

        disk.require_room(self.path)
        part = self.path.with_name(PART)
        shutil.rmtree(part, ignore_errors=True)
        try:
            scenario = self.sim.scenario
            facts = {
                "format": FORMAT,
                "title": f"Gas maps of {scenario.name}",
                "source": f"taichi_plume {__version__}",
                **scenario.seeds,
                "maps": len(self.map_scores.series),
            }
            found = beliefs(self.sim)
            facts["beliefs"] = len(found)
            root = zarr_groups.create(part, facts)
            parts = [
                (str(n), self._facts(n), _variables(series))
                for n, series in enumerate(self.map_scores.series)
            ]
            parts += [(f"belief_{k}", self._believed(one), _belief(one)) for k, one in enumerate(found)]
            for path, told, variables in parts:
                group = root.create_group(path, attributes={"Conventions": zarr_groups.CONVENTIONS, **told})
                for name, values in variables.items():
                    units, meaning, dimensions = MEANING[name]
                    facts = {"units": units, "long_name": meaning} | _axis(name)
                    zarr_groups.add(group, name, dimensions or (name,), values, facts)
                zarr_groups.consolidate(part, path)
            zarr_groups.consolidate(part)
            part.rename(self.path)
        finally:
            shutil.rmtree(part, ignore_errors=True)

    def _facts(self, n: int) -> dict[str, Any]:
        model, series = self.sim.scenario.maps[n], self.map_scores.series[n]
        rivals = len(series.parts) > 1
        names = [group.name for group in self.sim.swarm.groups] if self.sim.swarm.count else []
        made = [[names[k]] if rivals else names for k in range(len(series.parts))]
        return {
            "title": f"Gas map {n} of {self.sim.scenario.name}",
            **model.model_dump(mode="json"),
            "t_s": self.sim.t,
            "groups": [
                {"names": who, "first_trial": rows.start, "trials": rows.stop - rows.start}
                for who, rows in zip(made, series.parts, strict=True)
            ],
        }

    def _believed(self, one: "GroupBeliefs") -> dict[str, Any]:
        kind = one.group.model.algorithm.kind
        return {
            "title": f"What {one.group.name} believes",
            "group": one.group.name,
            "algorithm": kind,
            "cell_m": one.cell,
            "t_s": self.sim.t,
        }


def _axis(name: str) -> dict[str, str]:
    return {"axis": name.upper()} if name in ("x", "y") else {}


def _variables(series: "MapSeries") -> dict[str, np.ndarray]:
    """By name, as they are stored."""
    from taichi_plume.simulation import Uncertain  # brings Taichi, which those that only read do without

    estimate = np.asarray(series.map.estimate(), np.float32)
    trials, nx, ny = estimate.shape
    cells = {"estimate": estimate, "weight": np.asarray(series.map.weight(), np.float32)}
    if isinstance(series.map, Uncertain):
        cells["variance"] = np.asarray(series.map.variance(), np.float32)
    cells["truth"] = np.broadcast_to(series.truth.astype(np.float32), estimate.shape)
    return {
        "trial": np.arange(trials, dtype=np.int32),
        "y": (np.arange(ny) + 0.5) * series.cell,
        "x": (np.arange(nx) + 0.5) * series.cell,
        **{name: np.ascontiguousarray(values.transpose(0, 2, 1)) for name, values in cells.items()},
        "measurable": series.measurable.T.astype(np.int8),
    }


def _belief(one: "GroupBeliefs") -> dict[str, np.ndarray]:
    """By name, as they are stored."""
    x, y = one.axes()
    trials, robots = one.p.shape[:2]
    return {
        "trial": np.arange(trials, dtype=np.int32),
        "robot": np.arange(robots, dtype=np.int32),
        "y": y,
        "x": x,
        "probability": np.ascontiguousarray(one.p.transpose(0, 1, 3, 2), np.float32),
    }


@contextmanager
def opened(path: Path, what: Literal["maps", "beliefs"] = "maps") -> Iterator[list[Any]]:
    """The groups (`zarr_groups.Group`) of a run's maps, or of its beliefs, of which no chunk is missing.

    Raises RunFolderError where the file is none of ours or not whole, or what reads it finds that.
    """
    from taichi_plume.files import zarr_groups

    damage = manifest.changed(path)
    if damage:
        raise RunFolderError(damage)

    name = "{}" if what == "maps" else "belief_{}"
    try:
        root = zarr_groups.Group(path).attributes
        if root.get("format") != FORMAT:
            raise RunFolderError(f"{path}: was made by another version (its format is not '{FORMAT}')")
        groups = [
            zarr_groups.Group(path, name.format(n))
            for n in range(int(root["maps"] if what == "maps" else root.get(what, 0)))
        ]
        for group in groups:
            zarr_groups.require_memory({name: group[name] for name in group.names})
        yield groups
    except RunFolderError:
        raise
    except zarr_groups.GroupError as error:
        raise RunFolderError(str(error)) from None
    except zarr_groups.FAULTS as error:
        raise RunFolderError(f"{path}: is damaged: {zarr_groups.reason(error)}") from None


def read(path: Path) -> "list[xarray.Dataset]":
    """The maps of a run, in memory. Raises RunFolderError where the file is none of ours or not whole."""
    with opened(path) as groups:
        maps = [_loaded(path, group) for group in groups]
        for n, one in enumerate(maps):
            if tuple(one["estimate"].dims) != WHOLE:
                raise ValueError(f"map {n} has an estimate of {one['estimate'].dims}")
    return maps


def _loaded(path: Path, group: Any) -> "xarray.Dataset":
    from taichi_plume.files import zarr_groups

    return zarr_groups.open_dataset(path, group=group.name, consolidated=False).load()


def read_beliefs(path: Path) -> "list[xarray.Dataset]":
    """Read the beliefs of each group of a run. Raises RunFolderError if the file is foreign or incomplete."""
    with opened(path, "beliefs") as groups:
        return [_loaded(path, group) for group in groups]
