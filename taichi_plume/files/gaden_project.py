"""Projects of GADEN as scenarios: room, wind, source and gas of a project in the keys of a scenario.

`gaden: PATH` in a scenario names one of these files, or a folder above that holds only one:

    environment_configurations/CONFIG/simulations/SIM/sim.yaml
        GADEN 3; CONFIG/config.yaml names wind and models, beside it, after preprocessing, OccupancyGrid3D.csv
    simulations/SIM.yaml
        GADEN 2; beside the folder are wind_simulations/, params/preproc_params.yaml, which names the models, and, after
        preprocessing, OccupancyGrid3D.csv

The grid of a project that is not preprocessed is made of the models: see files/gaden_models.py. Keys of the scenario
take precedence over those of the project. GADEN's lengths of filaments are in cm, pressures in atm.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from taichi_plume.files import gaden, gaden_models
from taichi_plume.files.gaden_models import OLD, configuration
from taichi_plume.files.gaden_results import GASES
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.guard.safe_open import require_inside, unopenable
from taichi_plume.scenario.loading import ScenarioError, read_mapping
from taichi_plume.scenario.species import SPECIES

CONFIGS, SIMULATIONS, OCCUPANCY = "environment_configurations", "simulations", "OccupancyGrid3D.csv"
FACES = ("x-", "x+", "y-", "y+", "z-", "z+")
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
    """Files of a GADEN project. sim: keys of its simulation; config: keys of its configuration or {}; listing: the
    configuration's file; home: folder of the occupancy grid; new: GADEN 3; notes: keys without an equivalent.
    """

    file: Path
    sim: dict[str, Any]
    config: dict[str, Any]
    listing: Path
    home: Path
    new: bool
    notes: list[str] = field(default_factory=list)

    def number(self, name: str) -> float:
        """Return a simulation parameter, or its default, as a float. Raises ScenarioError if it is no number >= 0."""
        keys, default = KEYS[name]
        value = next((self.sim[key] for key in keys if key in self.sim), default)
        number = gaden_models.number(value, 0.0, 1e9)
        if number is None:
            raise self.wrong(f"{keys[0]}: got {value!r}, must be a number of 0 or more")
        return number

    def note(self, what: str) -> None:
        """Add a note for the user, such as on a GADEN key without an equivalent."""
        self.notes.append(f"gaden: {what}")

    def wrong(self, what: str) -> ScenarioError:
        """Return an error that names the file of the GADEN simulation."""
        return ScenarioError([f"gaden: {self.file}: {what}"])


def expanded(data: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[str]]:
    """Return scenario data with the content of the GADEN project under its key `gaden`, and notes for the user.

    The notes name project keys without an equivalent. Raises ScenarioError.
    """
    name = data["gaden"]
    if not isinstance(name, str) or not name or "\0" in name:
        raise ScenarioError([f"gaden: must be a path in a project of GADEN's, got {name!r}"])
    try:
        require_inside(folder / name)
    except OSError as error:
        raise ScenarioError([f"gaden: {name} {error.strerror}; or put both into one folder"]) from None
    project = _project_at(folder / name)
    own = {key: value for key, value in data.items() if key != "gaden"}
    return _merged(_scenario(project, folder, _corner(own)), own), project.notes


def _corner(own: dict[str, Any]) -> np.ndarray | None:
    """Return the domain's lower corner in GADEN coordinates [m], set as `wind.origin` in the scenario; else None."""
    wind = own.get("wind")
    origin = wind.get("origin") if isinstance(wind, dict) else None
    corner = [gaden_models.number(x, -1e7, 1e7) for x in origin] if isinstance(origin, list) else []
    return np.array(corner, float) if len(corner) == 3 and None not in corner else None


def _merged(below: Any, above: Any) -> Any:
    """Merge two nested mappings; values of `above` win, and replace a mapping of another `kind` as a whole."""
    if not isinstance(below, dict) or not isinstance(above, dict):
        return above
    if "kind" in above and above["kind"] != below.get("kind"):
        return above
    return below | {
        key: _merged(below[key], value) if key in below else value for key, value in above.items()
    }


# ---------------------------------------------------------------- files


def _project_at(path: Path) -> _Project:
    if path.suffix == ".gproj" or path.name == "config.yaml":
        path = path.parent
    files = [path] if os.path.isfile(path) else sorted(_simulations(path)) if os.path.isdir(path) else []
    if len(files) != 1:
        names = ", ".join(os.path.relpath(file, path) for file in files[:10])
        what = f"several simulations; name one of {names}" if files else "no simulation of GADEN's"
        raise ScenarioError([f"gaden: {path}: holds {what}"])
    file = files[0]
    sim = read_mapping(file, "a simulation has a source at least")
    home = file.parent.parent  # at the root `parent` is the root again; `parents` would be too short
    if file.name == "sim.yaml":
        home = home.parent
        return _Project(file, sim, configuration(home / "config.yaml"), home / "config.yaml", home, True)
    listing = home / "params" / OLD
    return _Project(file, sim, configuration(listing) if listing.is_file() else {}, listing, home, False)


def _simulations(path: Path) -> Iterator[Path]:
    """Yield the simulation files of GADEN in the folder of a simulation, a configuration or a project."""
    if (path / "sim.yaml").is_file():
        yield path / "sim.yaml"
        return
    for home in (path, *sorted(path.glob(f"{CONFIGS}/*"))):
        yield from home.glob(f"{SIMULATIONS}/*/sim.yaml")
    if not any(path.glob(f"{CONFIGS}/*/{SIMULATIONS}/*/sim.yaml")):
        yield from path.glob(f"{SIMULATIONS}/*.yaml")


def _wind_files(project: _Project, folder: Path) -> str:
    """Return the pattern, such as wind_%d.csv, of a GADEN project's wind files, relative to `folder`."""
    wind, place = project.config.get("unprocessed_wind_files"), project.home
    if not project.new:
        wind, place = project.sim.get("wind_sim_path"), project.home / "wind_simulations"
    if not project.new and wind is None:  # the launch file gives it; only one wind may exist
        given = project.config.get("wind_files")
        files = sorted(place.glob("**/*_0.csv"))
        if isinstance(given, str) and "$(var wind_sim_path)" not in given:
            first = gaden_models.located(project.listing, f"{given}_0.csv")
            wind, place = str(first).removesuffix("_0.csv"), Path()
        elif len(files) == 1:
            wind = str(files[0]).removesuffix("_0.csv")
        elif files:
            names = ", ".join(str(file.relative_to(place)).removesuffix("_0.csv") for file in files[:10])
            raise project.wrong(f"wind_sim_path: is missing; set it to one of the winds {names}")
    if not isinstance(wind, str) or not wind:
        raise project.wrong("names no wind files; set unprocessed_wind_files, or wind_sim_path")
    name = os.path.relpath(place / wind, folder)
    fault = unopenable(folder / f"{name}_0.csv")
    if fault:
        raise project.wrong(f"its wind {wind}_0.csv {fault}")
    return f"{name}_%d.csv"


def _scenario(project: _Project, folder: Path, corner: np.ndarray | None) -> dict[str, Any]:
    """Return scenario data for a GADEN project. corner: lower corner of the domain [m], by default of the room."""
    if project.config.get("uniformWind") is True:
        raise project.wrong("its wind is uniform, also in walls; give a wind of kind cfd and a domain")
    occupancy = project.home / OCCUPANCY
    if not occupancy.exists():
        if not project.config:
            where = f"an {OCCUPANCY} in {project.home} nor a params/{OLD}, which lists the models"
            raise project.wrong(f"there is neither {where}")
        occupancy = project.listing
        project.note(
            f"the project has no {OCCUPANCY} yet; its grid is made of the models that {occupancy.name} lists"
        )
    room = _of_grid(occupancy, project, folder)
    low, wind = room.pop("low"), room.pop("wind")
    low = low if corner is None else corner
    loop = next((project.sim[key] for key in ("windLooping", "wind_looping") if key in project.sim), {})
    loops = isinstance(loop, dict) and bool(loop.get("loop"))
    if loops and loop.get("from"):
        project.note("its wind loops from a later file on; here all files are looped")
    duration = project.number("duration") or project.number("iterations") * project.number("step")
    wind |= {"kind": "imported", "files": _wind_files(project, folder), "loop": loops}
    wind |= {"interval": project.number("wind_step"), "origin": [float(x) for x in low]}
    return {"duration": duration, **room, "wind": wind, "gas": _gas(project, low)}


def _of_grid(occupancy: Path, project: _Project, folder: Path) -> dict[str, Any]:
    """Return domain size, lower corner and walls from GADEN's occupancy grid, or from a list of its models."""
    try:
        grid = gaden.read(occupancy)
    except WindFileError as error:
        raise ScenarioError([f"gaden: {error}"]) from None
    open_ = _open_faces(grid.cubes)
    layers = np.flatnonzero((grid.cubes != 1).any(axis=(0, 1)))  # without floor and ceiling
    if not len(layers):
        raise project.wrong(f"{occupancy.name} holds no air")
    if (grid.cubes == 2).any() and not open_:
        project.note("none of its outlets lies in a face of the domain, so no air comes in or goes out")
    shape = (*grid.cubes.shape[:2], layers[-1] + 1 - layers[0])
    return {
        "low": grid.low + np.array([0.0, 0.0, grid.size * layers[0]]),
        "domain": {"size": [float(n * grid.size) for n in shape], "spacing": grid.size},
        "wind": {
            "occupancy": os.path.relpath(occupancy, folder),
            "walls": [face for face in FACES if face not in open_],
        },
    }


def _open_faces(cubes: np.ndarray) -> set[str]:
    """Return boundary faces with outlets; an outlet at several faces opens those along whose normal it is thinnest."""
    faces: set[str] = set()
    for box in ndimage.find_objects(ndimage.label(cubes == 2)[0]):  # type: ignore[index]
        touched = {
            face: (box[a].stop - box[a].start)
            for face, a, end in zip(FACES, (0, 0, 1, 1, 2, 2), (0, 1) * 3, strict=True)
            if (box[a].stop == cubes.shape[a] if end else box[a].start == 0)
        }
        faces |= {face for face, edge in touched.items() if edge == min(touched.values())}
    return faces


def _gas(project: _Project, low: np.ndarray) -> dict[str, Any]:
    """Return the scenario's `gas`: puffs with the species, size and release rate of GADEN's filaments."""
    source = project.sim.get("source")
    source = source if isinstance(source, dict) else {}
    plain = [project.sim.get(f"source_{axis}") for axis in "xyz"]
    place = source.get("position", project.sim.get("sourcePosition", plain))
    kind = source.get("gasType", project.sim.get("gasType", project.sim.get("gas_type", 0)))
    numbers = place if isinstance(place, list) and len(place) == 3 else [None]
    if any(gaden_models.number(x, -1e9, 1e9) is None for x in numbers):
        raise project.wrong(f"its source must be at three numbers, got {place!r}")
    radius = SMALLEST
    shape = source.get("sourceType", "point")
    if shape == "sphere":
        radius = gaden_models.number(source.get("radius"), 0.0, 1e5)
        if radius is None:
            raise project.wrong(f"radius: got {source.get('radius')!r}, must be a length in m")
    elif shape != "point":
        project.note(f"a source of type {shape} is released from a point, its position")
    if not isinstance(kind, int) or isinstance(kind, bool) or not 0 <= kind < len(GASES):
        raise project.wrong(f"gasType: got {kind!r}, must be a number from 0 to {len(GASES) - 1}")
    sigma, rate, step = project.number("sigma") / 100.0, project.number("rate"), project.number("step")
    if not sigma or not rate or not step:
        raise project.wrong("its filaments need a size, a rate and a time step above 0")
    species = GASES[kind]
    if species not in SPECIES:
        raise project.wrong(f"its gas is {species}, which has no molar mass; choose another gasType")
    moles = project.number("ppm") * 1e-6 * project.number("pressure") * ATM
    moles *= (2.0 * pi) ** 1.5 * sigma**3 / (GAS_CONSTANT * max(project.number("temperature"), 1.0))
    # diffusivity of the filament's random steps: see docs/coming-from/gaden.md
    noise = project.number("noise")
    diffusivity = 50.0 * noise**2 * step if project.new else 0.5 * noise**2 / step
    where = {"position": [float(x) for x in np.array(numbers) - low], "radius": radius}
    return {
        "kind": "puffs",
        "species": species,
        "sources": [where | {"rate": rate * moles * SPECIES[species].molar_mass}],
        "release_rate": rate,
        "initial_size": sigma,
        "growth": {"kind": "diffusive", "rate": project.number("growth") * 1e-4},
        "fluctuation": sqrt(diffusivity / FLUCTUATION_TIME),
        "fluctuation_time": FLUCTUATION_TIME,
        "handover": False,
        "buoyancy": True,
    }
