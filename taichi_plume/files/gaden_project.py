"""A project of GADEN's as a scenario: where its room, wind, source and gas are, and what they are called here.

`gaden: PATH` in a scenario names one of these, or a folder above that holds one alone:

    environment_configurations/CONFIG/simulations/SIM/sim.yaml
        GADEN 3; CONFIG/config.yaml names wind and models, beside it is, once preprocessed, OccupancyGrid3D.csv
    simulations/SIM.yaml
        GADEN 2; beside the folder are wind_simulations/, cad_models/ and, once preprocessed, OccupancyGrid3D.csv

Keys of the scenario itself come before those of the project. Lengths of filaments are in cm there, pressures in atm.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import isfinite, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files import gaden
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.grid.mesh_files import MeshError, read_mesh
from taichi_plume.scenario.input_files import outside
from taichi_plume.scenario.loading import ScenarioError, read_mapping
from taichi_plume.scenario.species import SPECIES

CONFIGS, SIMULATIONS, OCCUPANCY = "environment_configurations", "simulations", "OccupancyGrid3D.csv"
GASES = (
    "ethanol", "methane", "hydrogen", "propanol", "chlorine", "fluorine", "acetone", "neon", "helium", "biogas",
    "butane", "carbon dioxide", "carbon monoxide", "smoke",
)  # fmt: skip
OURS = {"propanol": "1-propanol"}
KEYS = {  # of GADEN 3, its first versions and GADEN 2; the default
    "step": (("deltaTime", "time_step"), 0.1),
    "wind_step": (("windIterationDeltaTime", "wind_time_step"), 1.0),
    "temperature": (("temperature",), 298.0),
    "pressure": (("pressure",), 1.0),
    "ppm": (("filamentPPMcenter", "filament_ppm_center", "ppm_filament_center"), 20.0),
    "sigma": (("filamentInitialSigma", "filament_initial_sigma", "filament_initial_std"), 10.0),
    "growth": (("filamentGrowthGamma", "filament_growth_gamma"), 10.0),
    "noise": (("filamentNoise_std", "filament_noise_std"), 0.02),
    "rate": (("numFilaments_sec", "num_filaments_sec"), 10.0),
    "iterations": (("expectedNumIterations",), 600.0),
    "duration": (("sim_time",), 0.0),
}
FLUCTUATION_TIME = 0.5  # s
SMALLEST = 0.02  # m: radius of a point, as which GADEN releases
GAS_CONSTANT, ATM = 8.314462618, 101325.0


@dataclass
class _Project:
    """sim: the simulation's file and what it says; config: the same of GADEN 3's configuration, else empty; home: the
    folder of the occupancy grid; notes: what could not be carried over.
    """

    file: Path
    sim: dict[str, Any]
    config: dict[str, Any]
    home: Path
    notes: list[str] = field(default_factory=list)

    def number(self, name: str) -> float:
        """One of KEYS. Raises ScenarioError."""
        keys, default = KEYS[name]
        value = next((self.sim[key] for key in keys if key in self.sim), default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < 1e9:
            raise self.wrong(f"{keys[0]}: got {value!r}, must be a number of 0 or more")
        return float(value)

    def wrong(self, what: str) -> ScenarioError:
        """A fault of the simulation's file."""
        return ScenarioError([f"gaden: {self.file}: {what}"])


def expanded(data: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[str]]:
    """The data of a scenario in a folder, with its `gaden` carried out, and what could not be carried over.

    Raises ScenarioError.
    """
    name = data["gaden"]
    if not isinstance(name, str) or not name or "\0" in name:
        raise ScenarioError([f"gaden: must be a path in a project of GADEN's, got {name!r}"])
    if outside(folder, name):
        raise ScenarioError(
            [f"gaden: {name} lies outside the scenario's folder; put the scenario beside the project"]
        )
    project = _found(folder / name)
    own = {key: value for key, value in data.items() if key != "gaden"}
    return _merged(_scenario(project, folder), own), project.notes


def _merged(below: Any, above: Any) -> Any:
    """Mappings joined, what is above first; of other kinds only what is above."""
    if not isinstance(below, dict) or not isinstance(above, dict):
        return above
    if "kind" in above and above["kind"] != below.get("kind"):
        return above
    return below | {
        key: _merged(below[key], value) if key in below else value for key, value in above.items()
    }


# ---------------------------------------------------------------- files


def _found(path: Path) -> _Project:
    files = [path] if os.path.isfile(path) else sorted(_simulations(path)) if os.path.isdir(path) else []
    if len(files) != 1:
        names = ", ".join(os.path.relpath(one, path) for one in files[:10])
        told = (
            f"holds several simulations; name one of {names}" if files else "holds no simulation of GADEN's"
        )
        raise ScenarioError([f"gaden: {path}: {told}"])
    file = files[0]
    sim = read_mapping(file, "a simulation has a source at least")
    config = file.parents[2] / "config.yaml" if file.name == "sim.yaml" else None
    if config is not None and config.is_file():
        return _Project(file, sim, read_mapping(config, "a configuration names its models"), config.parent)
    return _Project(file, sim, {}, file.parents[2] if file.name == "sim.yaml" else file.parents[1])


def _simulations(path: Path) -> Iterator[Path]:
    """The files of the simulations in a folder: of a simulation, a configuration or a project."""
    if (path / "sim.yaml").is_file():
        yield path / "sim.yaml"
        return
    for configuration in (path, *sorted(path.glob(f"{CONFIGS}/*"))):
        yield from configuration.glob(f"{SIMULATIONS}/*/sim.yaml")
    if not any(path.glob(f"{CONFIGS}/*/{SIMULATIONS}/*/sim.yaml")):
        yield from path.glob(f"{SIMULATIONS}/*.yaml")


def _wind_files(project: _Project, folder: Path) -> str:
    """The wind as a scenario in `folder` names it."""
    if project.config:
        told = project.config.get("unprocessed_wind_files")
        place = project.home
    else:
        told, place = project.sim.get("wind_sim_path"), project.home / "wind_simulations"
    if not isinstance(told, str) or not told:
        raise project.wrong("names no wind files (unprocessed_wind_files, or wind_sim_path)")
    if not os.path.isfile(place / f"{told}_0.csv"):
        raise project.wrong(f"its wind {told}_0.csv is not there")
    return f"{os.path.relpath(place / told, folder)}_%d.csv"


def _models(project: _Project, key: str) -> list[Path]:
    """The STL files of walls and furniture, or of outlets."""
    listed = project.config.get(key)
    if not project.config:
        files = sorted((project.home / "cad_models").glob("*.stl"))
        outlets = [
            file for file in files if any(word in file.name.lower() for word in ("door", "outlet", "inlet"))
        ]
        return outlets if key == "outlets_models" else [file for file in files if file not in outlets]
    names = [
        one
        for one in (listed if isinstance(listed, list) else [])
        if isinstance(one, str) and one and not one.startswith("!")
    ]
    for name in names:
        if not name.lower().endswith(".stl"):
            project.notes.append(f"gaden: the model {name} is no STL file; it is left out, as GADEN does")
    return [project.home / name for name in names if name.lower().endswith(".stl")]


# ---------------------------------------------------------------- what they say


def _scenario(project: _Project, folder: Path) -> dict[str, Any]:
    """The scenario that a project stands for."""
    config = project.config
    if config.get("uniformWind") is True:
        raise project.wrong(
            "its wind is uniform, which blows through walls; give a wind of kind cfd and a domain"
        )
    occupancy = project.home / OCCUPANCY
    room = _of_grid(occupancy, project, folder) if occupancy.is_file() else _of_models(project, folder)
    low, wind = room.pop("low"), room.pop("wind")
    loop = next((project.sim[key] for key in ("windLooping", "wind_looping") if key in project.sim), {})
    loops = isinstance(loop, dict) and bool(loop.get("loop"))
    if loops and loop.get("from"):
        project.notes.append("gaden: its wind loops from a later file on; here all files are looped")
    duration = project.number("duration") or project.number("iterations") * project.number("step")
    wind |= {"kind": "imported", "files": _wind_files(project, folder), "loop": loops}
    wind |= {"interval": project.number("wind_step"), "origin": [float(x) for x in low]}
    return {"duration": duration, **room, "wind": wind, "gas": _gas(project, low)}


def _of_grid(occupancy: Path, project: _Project, folder: Path) -> dict[str, Any]:
    """Domain and walls of a project that GADEN has preprocessed."""
    try:
        grid = gaden.read(occupancy)
    except WindFileError as error:
        raise ScenarioError([f"gaden: {error}"]) from None
    ends = [np.take(grid.cubes, end, axis=axis) for axis in range(3) for end in (0, -1)]
    faces = ("x-", "x+", "y-", "y+", "z-", "z+")
    layers = np.flatnonzero((grid.cubes != 1).any(axis=(0, 1)))  # without those of floor and ceiling
    if not len(layers):
        raise project.wrong(f"{OCCUPANCY} holds no air")
    shape = (*grid.cubes.shape[:2], layers[-1] + 1 - layers[0])
    return {
        "low": grid.low + np.array([0.0, 0.0, grid.size * layers[0]]),
        "domain": {"size": [float(n * grid.size) for n in shape], "spacing": grid.size},
        "wind": {
            "occupancy": os.path.relpath(occupancy, folder),
            "walls": [face for face, end in zip(faces, ends, strict=True) if not (end == 2).any()],
        },
    }


def _of_models(project: _Project, folder: Path) -> dict[str, Any]:
    """Those of a project that it has not: the box around the models, which stand in it as meshes."""
    cell = project.config.get("cell_size", 0.1)
    if isinstance(cell, bool) or not isinstance(cell, int | float) or not 1e-3 < cell < 100:
        raise project.wrong(f"cell_size: got {cell!r}, must be an edge in m")
    models, outlets = _models(project, "models"), _models(project, "outlets_models")
    if not models:
        raise project.wrong(f"there is neither an {OCCUPANCY} nor an STL model of the room")
    try:
        corners = [read_mesh(file)[0] for file in models]
        vents = [read_mesh(file)[0] for file in outlets]
    except MeshError as error:
        raise ScenarioError([f"gaden: {error}"]) from None
    low, high = np.concatenate(corners).min(axis=0), np.concatenate(corners).max(axis=0)
    faces = [(f"{'xyz'[a]}{'-+'[end]}", a, (low, high)[end][a]) for a in range(3) for end in (0, 1)]
    closed = [
        name for name, a, edge in faces if all(np.abs(v[:, a] - edge).min() > 0.5 * cell for v in vents)
    ]
    project.notes.append(
        f"gaden: the project has no {OCCUPANCY} yet, so its {len(models)} models stand in the domain as meshes, and "
        "the walls of the domain are those of its faces that no outlet touches"
    )
    shift = [float(-x) for x in low]
    return {
        "low": low,
        "domain": {"size": [float(x) for x in high - low], "spacing": float(cell)},
        "obstacles": [
            {"kind": "mesh", "file": os.path.relpath(file, folder), "translate": shift} for file in models
        ],
        "wind": {"walls": closed},
    }


def _gas(project: _Project, low: np.ndarray) -> dict[str, Any]:
    """Puffs with the gas, the sizes and the rate of the filaments."""
    source = project.sim.get("source")
    source = source if isinstance(source, dict) else {}
    plain = [project.sim.get(f"source_{axis}") for axis in "xyz"]
    place = source.get("position", project.sim.get("sourcePosition", plain))
    kind = source.get("gasType", project.sim.get("gasType", project.sim.get("gas_type", 0)))
    numbers = place if isinstance(place, list) and len(place) == 3 else [None]
    if not all(isinstance(x, int | float) and not isinstance(x, bool) and isfinite(x) for x in numbers):
        raise project.wrong(f"its source must be at three numbers, got {place!r}")
    radius = SMALLEST
    shape = source.get("sourceType", "point")
    if shape == "sphere" and isinstance(source.get("radius"), int | float):
        radius = float(source["radius"])
    elif shape != "point":
        project.notes.append(f"gaden: a source of type {shape} is released from a point, its position")
    name = GASES[kind] if isinstance(kind, int) and 0 <= kind < len(GASES) else None
    if name is None:
        raise project.wrong(f"gasType: got {kind!r}, must be a number from 0 to {len(GASES) - 1}")
    sigma, rate, step = project.number("sigma") / 100.0, project.number("rate"), project.number("step")
    if not sigma or not rate or not step:
        raise project.wrong("its filaments need a size, a rate and a time step above 0")
    species, molar_mass = _species(project, name)
    moles = project.number("ppm") * 1e-6 * project.number("pressure") * ATM
    moles *= (2.0 * pi) ** 1.5 * sigma**3 / (GAS_CONSTANT * max(project.number("temperature"), 1.0))
    # the filament's random steps as a diffusivity: see docs/coming-from/gaden.md
    noise = project.number("noise")
    diffusivity = 50.0 * noise**2 * step if project.config else 0.5 * noise**2 / step
    where = {"position": [float(x) for x in np.array(numbers) - low], "radius": radius}
    return {
        "kind": "puffs",
        "species": species,
        "sources": [where | {"rate": rate * moles * molar_mass}],
        "release_rate": rate,
        "initial_size": sigma,
        "growth": {"kind": "diffusive", "rate": project.number("growth") * 1e-4},
        "fluctuation": sqrt(diffusivity / FLUCTUATION_TIME),
        "fluctuation_time": FLUCTUATION_TIME,
        "handover": False,
        "buoyancy": True,
    }


def _species(project: _Project, name: str) -> tuple[str, float]:
    """A gas as a scenario names it, and its molar mass [kg/mol]."""
    ours = OURS.get(name, name.replace(" ", "_"))
    if ours not in SPECIES:
        raise project.wrong(
            f"its gas is {name}, which has no molar mass of its own here; choose another gasType"
        )
    return ours, SPECIES[ours].molar_mass
