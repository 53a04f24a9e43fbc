"""Bank of recorded flow and gas for reinforcement learning, solved once per scenario; see solvers/film_bank.py.

Films hold planes at the heights of the sensors, or for drones volumes: means over the air of blocks of `task.spacing`,
between `task.heights`. On disk a bank is a zarr group. A hash of all that affects the recorded flow realisations
identifies the scenario.
"""

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from math import ceil, prod
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from taichi_plume.assembly.preparation import checked
from taichi_plume.envs.task import require_parted
from taichi_plume.grid.fields import concentration_at, velocity_at
from taichi_plume.guard.input_error import InputError
from taichi_plume.scenario.gases import PlaybackGas
from taichi_plume.scenario.playback import PlaybackWind
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.species import Species
from taichi_plume.scenario.task import Task
from taichi_plume.solvers.film_bank import half
from taichi_plume.studies.ids import Digests
from taichi_plume.studies.scenario_checks import Checks
from taichi_plume.studies.shared_air import alone
from taichi_plume.time_loop import Every, TimeLoop

FORMAT = "taichi_plume bank 1"
ARRAYS = ("values", "scale", "air")
MOST = 2**31 - 1  # most elements of a field, as Taichi's indices have 32 bits


@dataclass(frozen=True)
class Bank:
    """Recordings (films) of a scenario's flow realisations, all of equal length.

    values, scale, air, low: see `FilmBank`. sources: source positions of each gas in each film [m], (sources, 2), of
    volumes (sources, 3); key: hash of all that affects the films.
    """

    values: np.ndarray
    scale: np.ndarray
    air: np.ndarray
    spacing: float
    frame: float
    species: tuple[Species, ...]
    sources: tuple[tuple[np.ndarray, ...], ...]
    key: str
    low: float = 0.0

    @property
    def films(self) -> int:
        """Number of recordings, one per realisation of the flow."""
        return self.values.shape[0]

    @property
    def length(self) -> float:
        """Duration of each recording [s]: the time of its last frame; the first is at 0."""
        return (self.values.shape[1] - 1) * self.frame

    def write(self, path: Path) -> None:
        """Write the bank as a zarr group, in place of an existing bank. Raises ValueError for other files, OSError."""
        from taichi_plume.files import disk, zarr_groups

        path.parent.mkdir(parents=True, exist_ok=True)
        if os.path.lexists(path):
            require_bank(path)
        disk.require_room(path.parent / path.name, self.values.nbytes)
        about = {
            "format": FORMAT,
            "key": self.key,
            "spacing": self.spacing,
            "frame": self.frame,
            "low": self.low,
        }
        about["species"] = json.dumps([asdict(species) for species in self.species])
        about["sources"] = json.dumps([[places.tolist() for places in film] for film in self.sources])
        part = disk.new_folder_beside(path)
        try:
            group = zarr_groups.create(part, about)
            chunk = (1, min(16, self.values.shape[1]), *self.values.shape[2:])
            axes = ("x", "y", "z")[: self.air.ndim - 1]
            names = ("film", "time", *axes, "channel")
            units = {"units": "m s-1 for channels 0 and 1, scale ppm for the others"}
            zarr_groups.add(group, "values", names, self.values, units, chunk)
            zarr_groups.add(group, "scale", ("film", "gas"), self.scale, {"units": "ppm"})
            zarr_groups.add(group, "air", ("sensor", *axes), self.air, {})
            zarr_groups.consolidate(part)
            disk.discard(path)
            part.rename(path)
        finally:
            disk.discard(part)


def require_bank(path: Path) -> None:
    """Raise ValueError unless a path holds nothing but a bank, so that no other file is ever overwritten."""
    read(path)
    others = {file.name for file in path.iterdir()} - {"zarr.json", *ARRAYS}
    if others or path.is_symlink():
        what = f"holds {min(others)}, which is not a part of a bank" if others else "is a link"
        raise InputError(f"{path}: {what}; choose another --out")


def read(path: Path) -> Bank:
    """Read a bank of recordings from a zarr group. Raises ValueError, in one line, if missing or damaged."""
    from taichi_plume.files import zarr_groups

    makes = "python -m taichi_plume.envs makes banks"
    try:
        group = zarr_groups.Group(path)
        about = group.attributes
    except zarr_groups.GroupError as error:
        raise InputError(error) from None
    except zarr_groups.FAULTS:
        raise InputError(f"{path}: is not a zarr group; {makes}") from None
    if about.get("format") != FORMAT:
        raise InputError(f"{path}: is not a bank of this version; {makes}")
    with zarr_groups.errors_as(InputError, path):
        arrays = {name: group[name] for name in ARRAYS}
        zarr_groups.require_memory(arrays)
        values, scale, air = (arrays[name][...] for name in ARRAYS)
        species = tuple(Species(**keys) for keys in json.loads(about["species"]))
        dim = air.ndim - 1
        sources = tuple(
            tuple(np.array(places, float).reshape(-1, dim) for places in film)
            for film in json.loads(about["sources"])
        )
        spacing, frame, low = (float(about.get(name, 0.0)) for name in ("spacing", "frame", "low"))
        bank = Bank(values, scale, air, spacing, frame, species, sources, str(about["key"]), low)
        films, _, *cells, channels = bank.values.shape
        gases = channels - 2
        fits = bank.values.dtype == np.float16 and bank.scale.shape == (films, gases)
        fits &= (
            bank.air.shape == (2, *cells)
            and dim in (2, 3)
            and len(bank.species) == gases
            and bank.frame > 0 < bank.spacing
        )
        fits &= len(bank.sources) == films and all(len(film) == gases for film in bank.sources)
        if not (fits and np.isfinite(bank.values).all() and np.isfinite(bank.scale).all()):
            raise ValueError("the arrays do not fit each other")
    return bank


# ---------------------------------------------------------------- which airs there are


def airs(scenario: Scenario) -> list[Scenario]:
    """Return one scenario without robots for each flow realisation to record: per film to play back, or per seed.

    Frames are whole control periods apart. Without random numbers in the flow there is only one realisation.
    """
    task = scenario.task
    frame = frame_of(scenario)
    frames = max(1, ceil(task.length / frame - 1e-9))
    still = alone(scenario, frames * frame).model_copy(update={"task": Task()})
    if task.films:
        return [_playing(still, file) for file in task.films]
    seeds = range(task.airs) if scenario.air_by_chance else range(1)
    first = scenario.seed_of_air
    return [still.model_copy(update={"air_seed": (first + k) % 2**32}) for k in seeds]


def warnings(scenario: Scenario, folder: Path, allow_outside: bool = False) -> list[str]:
    """Return the warnings about the runs that are recorded, each once. Raises ScenarioError."""
    lines = (checked(air, folder, allow_outside).resources.warnings for air in airs(scenario))
    return list(dict.fromkeys(line for each in lines for line in each))


def frame_of(scenario: Scenario) -> float:
    """Return the time between recorded frames [s], rounded to whole control periods, at least one."""
    return max(1, round(scenario.task.frame / scenario.tick)) * scenario.tick


def _playing(scenario: Scenario, file: str) -> Scenario:
    """Return the scenario with `file` as the recording that wind and gas play back. Raises ValueError if none does."""
    gases = {
        path: gas.model_copy(update={"file": file})
        for path, gas in scenario.gases
        if isinstance(gas, PlaybackGas)
    }
    wind = scenario.wind
    if isinstance(wind, PlaybackWind):
        wind = wind.model_copy(update={"file": file})
    elif not gases:
        raise InputError(
            "task.films: neither wind nor gas is of kind playback; set one to playback, or remove the films"
        )
    return scenario.with_gases(gases).model_copy(update={"wind": wind})


def key_of(scenario: Scenario, folder: Path) -> str:
    """Return the hash of all that affects a bank: flow realisations, frame interval, sensor heights. Raises OSError."""
    digests, checks = Digests(folder), Checks(folder, allow_outside=True)
    ids = []
    for air in airs(scenario):
        files = checks.prepared(air).resources.files
        ids.append(digests.ids(air, files).air_of(air.seed, air.seed_of_air))
    _, coarse, layers = layout(scenario)
    coarser = [[coarse, layers]] if layers or coarse > 1 else []
    text = json.dumps([ids, f"{frame_of(scenario):.12g}", [f"{h:.12g}" for h in heights(scenario)], *coarser])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def heights(scenario: Scenario) -> tuple[float, ...]:
    """Return the heights [m] of the learning robots' anemometer and first gas sensor; none in 2-D and for drones."""
    if scenario.domain.dim == 2 or scenario.learners.body.flies:
        return ()
    sensors = scenario.learners.sensors
    return sensors.wind.height, sensors.nose.height


def layout(scenario: Scenario) -> tuple[tuple[int, ...], int, tuple[int, int] | None]:
    """Return the cells of a film along each axis, the edge of these cells in cells of the domain, and for drones the
    first layer of the domain in the film and the one behind the last.
    """
    domain, task = scenario.domain, scenario.task
    shape, layers = domain.shape[:2], None
    if scenario.learners.body.flies:
        low, high = task.heights or (0.0, domain.extent[2])
        layers = int(low / domain.spacing + 1e-9), ceil(high / domain.spacing - 1e-9)
        shape = *shape, layers[1] - layers[0]
    coarse = max(1, round(task.spacing / domain.spacing)) if task.spacing else 1
    return tuple(-(-n // coarse) for n in shape), coarse, layers


def bank_of(
    scenario: Scenario, folder: Path, bank: Bank | str | Path | None = None, allow_outside: bool = False
) -> Bank:
    """Return the bank given, as object or path, or record one if None. Raises ValueError if of another scenario."""
    if bank is None:
        return record(scenario, folder, allow_outside)
    if not isinstance(bank, Bank | str | Path):
        raise InputError(f"bank: got {type(bank).__name__}; give a Bank or the path of a bank")
    name = "the bank" if isinstance(bank, Bank) else str(bank)
    bank = bank if isinstance(bank, Bank) else read(Path(bank))
    if bank.key != key_of(scenario, folder):
        raise InputError(
            f"{name}: was recorded of another scenario (air, task or version differ); record the bank again with "
            "python -m taichi_plume.envs TASK.yaml --out BANK.zarr"
        )
    return bank


# ---------------------------------------------------------------- recording them


def record(
    scenario: Scenario,
    folder: Path = Path(),
    allow_outside: bool = False,
    tell: Callable[[int, int], object] | None = None,
) -> Bank:
    """Simulate all flow realisations of a scenario; return wind and gas where robots sense. Taichi must be running.

    tell: called with the numbers of finished and of all films. Raises ScenarioError for a faulty scenario, ValueError
    if the bank does not fit into memory, UnstableError.
    """
    from taichi_plume.assembly.assemble import build

    scenarios, (frames, _) = airs(scenario), check(scenario)
    count, (_, coarse, layers) = len(scenarios), layout(scenario)
    spacing, low = scenario.domain.spacing, (layers or (0,))[0] * scenario.domain.spacing
    sim: TimeLoop | None = None
    places: list[tuple[np.ndarray, ...]] = []
    species: Any = ()
    values, scales, air = np.empty(0), [], np.empty(0)
    for n, current in enumerate(scenarios):
        if tell is not None:
            tell(n, count)
        if sim is None:
            sim = build(checked(current, folder, allow_outside))
        else:
            sim.reset(current)
        filming = _Filming(sim, frame_of(scenario), frames, heights(scenario), coarse, layers)
        sim.run()
        mixed = tuple(gas.species for gas in sim.gas.gases)
        if n and (mixed != species or not np.array_equal(filming.air, air)):
            raise InputError(f"task.films[{n}]: has other species or other walls than the first film")
        species, air = mixed, filming.air
        if not n:
            values = np.empty((count, *filming.values.shape), np.float16)
        gases, scale = half(filming.values[..., 2:])
        values[n, ..., :2], values[n, ..., 2:] = filming.values[..., :2], gases
        scales.append(scale)
        places.append(
            tuple(
                np.array([s.position[: air.ndim - 1] for s in gas.sources], float)
                for _, gas in sim.scenario.gases
            )
        )
    if tell is not None:
        tell(count, count)
    frame, key = frame_of(scenario), key_of(scenario, folder)
    return Bank(
        values, np.stack(scales), air, coarse * spacing, frame, species, tuple(places), key, float(low)
    )


def check(scenario: Scenario) -> tuple[int, str]:
    """Return the number of frames in each recording of a bank for this scenario, and a text: films, cells and channels.

    Raises ValueError if the films do not fit into memory, ScenarioError as `require_parted` does.
    """
    require_parted(scenario)
    scenarios = airs(scenario)
    films, frames = len(scenarios), 1 + round(scenarios[0].duration / frame_of(scenario))
    cells, channels = layout(scenario)[0], 2 + len(scenario.gases)
    count = films * frames * prod(cells) * channels
    # half precision on host and device, and one film in single precision during recording
    needed, free = 2 * 2 * count + 4 * count // films, psutil.virtual_memory().available
    what = f"{films} films of {frames} frames, {frame_of(scenario):g} s apart, of {' x '.join(map(str, cells))} cells"
    narrower = ", narrow task.heights" if len(cells) == 3 else ""
    fewer = f"lower task.airs or task.film{narrower}, or raise task.frame or task.spacing"
    if count > MOST:
        raise InputError(f"task: {what} are {count:.3g} numbers, at most {MOST:.3g} are possible; {fewer}")
    if needed > free:
        raise InputError(
            f"task: {what} need {needed / 1e9:.3g} GB of memory, {free / 1e9:.3g} GB are free; {fewer}"
        )
    return frames, f"{what}: wind and {channels - 2} gases, {2e-6 * count:.3g} MB in memory"


class _Filming:
    """Observer that records wind and gas of a simulation where robots sense, frame by frame.

    values: (frames, nx, ny, 2 + gases), of volumes (frames, nx, ny, nz, 2 + gases), wind [m/s] and gases [ppm]; air
    (2, nx, ny) or (2, nx, ny, nz). coarse: edge of the film's cells in cells of the grid; layers: see `layout`.
    """

    def __init__(
        self,
        sim: TimeLoop,
        frame: float,
        frames: int,
        heights: tuple[float, ...],
        coarse: int = 1,
        layers: tuple[int, int] | None = None,
    ):
        self.coarse, self.part = coarse, (...,) if layers is None else (..., slice(*layers))
        self.levels = [_levels(sim.grid.shape[2], h / sim.grid.dx) for h in heights]
        centers = sim.grid.centers()[:, :, 0] if heights else sim.grid.centers()[(*self.part, slice(None))]
        self.points = [centers.copy(), centers.copy()]
        for points, h in zip(self.points, heights, strict=False):
            points[..., 2] = h
        solid = np.asarray(sim.air.solid)[self.part]
        self.solid = [solid, solid] if not heights else [solid[:, :, k].all(axis=2) for k, _ in self.levels]
        self.fine, self.whole = ~np.stack(self.solid), ~solid
        self.air = self._blocks(self.fine.astype(float), 1) > 0.0
        self.values = np.zeros((frames, *self.air.shape[1:], 2 + len(sim.gas.gases)), np.float32)
        self.count = 0
        sim.observers.append(Every(frame, self.keep))

    def keep(self, sim: TimeLoop) -> None:
        """Record wind and gas of the simulation's present time as the next frame; do nothing when all are recorded."""
        if self.count >= len(self.values):
            return
        frame = self.values[self.count]
        if self.coarse > 1:
            frame = np.zeros((*self.fine.shape[1:], frame.shape[-1]), np.float32)
        frame[..., :2] = velocity_at(sim.wind, self.points[0], sim.t)[..., :2]
        for g, gas in enumerate(sim.gas.gases):
            cells = gas.cells(sim.t)
            if cells is None:
                density = concentration_at(gas, self.points[1], sim.t)
            elif not self.levels:
                density = cells[self.part]
            else:
                density = _at_height(cells, self.whole, *self.levels[1])
            frame[..., 2 + g] = density * gas.species.ppm_per_density
        frame[~self.fine[1], 2:] = 0.0
        if self.coarse > 1:
            for row, channels in enumerate((slice(0, 2), slice(2, None))):
                air = self.fine[row, ..., None].astype(np.float32)
                mean = self._blocks(air * frame[..., channels], 0) / np.maximum(self._blocks(air, 0), 1.0)
                self.values[self.count, ..., channels] = mean
        self.count += 1

    def _blocks(self, values: np.ndarray, first: int) -> np.ndarray:
        """Return the sums of values over blocks of `coarse` cells along each axis of space, from axis `first` on."""
        for axis in range(first, first + self.fine.ndim - 1):
            values = np.add.reduceat(values, np.arange(0, values.shape[axis], self.coarse), axis=axis)
        return values


def _levels(n: int, at: float) -> tuple[list[int], list[float]]:
    """Return indices and weights of the grid layers, of n, around a height of `at` cells, for interpolation."""
    at = min(max(at - 0.5, 0.0), n - 1.0)
    low = min(int(at), max(n - 2, 0))
    share = at - low
    return ([low, low + 1], [1.0 - share, share]) if share > 0.0 else ([low], [1.0])


def _at_height(cells: np.ndarray, air: np.ndarray, levels: list[int], shares: list[float]) -> np.ndarray:
    """Return cell values (nx, ny) at a height, interpolated from (nx, ny, nz) between those layers that hold air."""
    weight = air[:, :, levels] * np.array(shares)
    return (weight * cells[:, :, levels]).sum(axis=2) / np.maximum(weight.sum(axis=2), 1e-6)
