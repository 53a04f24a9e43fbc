"""Projects of GADEN as scenarios: room, wind, source and gas of a project in the keys of a scenario.

`gaden: PATH` in a scenario names one of these files, or a folder above that holds only one:

    environment_configurations/CONFIG/simulations/SIM/sim.yaml
        GADEN 3; CONFIG/config.yaml names wind and models, beside it, after preprocessing, OccupancyGrid3D.csv
    simulations/SIM.yaml
        GADEN 2; beside the folder are wind_simulations/, params/preproc_params.yaml, which names the models,
        params/gaden_params.yaml, whose parameters take the values of the simulation for variables $(var NAME), and,
        after preprocessing, OccupancyGrid3D.csv

The grid of a project that is not preprocessed is made of the models: see files/gaden_models.py. Keys of the scenario
take precedence over those of the project. GADEN's lengths of filaments are in cm, pressures in atm.
"""

import itertools
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from taichi_plume.files import gaden, gaden_models, gaden_winds
from taichi_plume.files.gaden_models import OLD, SIMULATIONS, VARIABLE, configuration, parameters, substituted
from taichi_plume.files.gaden_results import GASES
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.guard.safe_open import require_inside, unopenable
from taichi_plume.scenario.loading import ScenarioError, read_mapping
from taichi_plume.scenario.species import AIR_MOLAR_MASS, SPECIES

CONFIGS, OCCUPANCY = "environment_configurations", "OccupancyGrid3D.csv"
PARAMETERS = ("params/gaden_params.yaml", "ros_params/gaden_params.yaml")
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
    "stop_steps": (("filament_stop_steps",), 0.0),
}
USED = {key for keys, _ in KEYS.values() for key in keys}
USED |= {"allow_looping", "loop_from_step", "loop_to_step", "variable_rate", "gas_type"}
GRAVITIES = {"fluorine": 1.31, "biogas": 0.8, "smoke": 0.89}
"""Specific gravities (air: 1) in GADEN's source code of gases that have no molar mass here."""
DIFFUSIVITY = 1.5e-5  # m²/s, assumed for these gases: about that of light gases in air
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
        key = next((key for key in keys if key in self.sim), keys[0])
        value = self.sim.get(key, default)
        number = gaden_models.number(value, 0.0, 1e9)
        if number is None:
            raise self.wrong(f"{key}: got {value!r}, must be a number of 0 or more")
        return number

    def flag(self, key: str, data: dict[str, Any] | None = None) -> bool:
        """Return a value that is true or false, by default false, of the simulation or `data`. Raises ScenarioError."""
        value = (self.sim if data is None else data).get(key, False)
        if not isinstance(value, bool) and value not in (0, 1):
            raise self.wrong(f"{key}: got {value!r}, must be true or false")
        return bool(value)

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
    notes: list[str] = []
    plain_sim, sim = sim, _with_parameters(file, sim, home, notes)
    listing = home / "params" / OLD
    if not listing.is_file():
        return _Project(file, sim, {}, listing, home, False, notes)
    plain = configuration(listing)
    config = {key: substituted(value, plain_sim) for key, value in plain.items()}
    if any(config[key] != value for key, value in plain.items() if key != "wind_files"):
        listing = file  # the models, or the grid, depend on the simulation
    return _Project(file, sim, config, listing, home, False, notes)


def _with_parameters(file: Path, sim: dict[str, Any], home: Path, notes: list[str]) -> dict[str, Any]:
    """Return the keys of a simulation of GADEN 2 with the parameters that the simulator takes from gaden_params.yaml.

    The simulation's values stand for variables $(var NAME) there; those without a value are added to the notes. Raises
    ScenarioError.
    """
    found = next((home / name for name in PARAMETERS if (home / name).is_file()), None)
    if found is None:
        return sim  # `_loop` says so
    needs = "it has the simulator's parameters"
    data = read_mapping(found, needs)
    values = {
        key: substituted(value, sim)
        for key, value in parameters(found, data, "gaden_filament_simulator", needs).items()
    }
    known = {}
    for key, value in values.items():
        if not isinstance(value, str) or not VARIABLE.search(value):
            known[key] = value
        elif key in USED - sim.keys():
            notes.append(
                f"gaden: {found}: {key}: {value} has no value in {file.name}; GADEN's default is taken"
            )
    for axis in "xyz":
        if f"source_position_{axis}" in known:
            known[f"source_{axis}"] = known.pop(f"source_position_{axis}")
    if "$(var wind_sim_path)" not in str(data) and isinstance(values.get("wind_data"), str):
        known["wind_data"] = values["wind_data"]
    return sim | known


def _simulations(path: Path) -> Iterator[Path]:
    """Yield the simulation files of GADEN in the folder of a simulation, a configuration or a project."""
    if (path / "sim.yaml").is_file():
        yield path / "sim.yaml"
        return
    for home in (path, *sorted(path.glob(f"{CONFIGS}/*"))):
        yield from home.glob(f"{SIMULATIONS}/*/sim.yaml")
    if not any(path.glob(f"{CONFIGS}/*/{SIMULATIONS}/*/sim.yaml")):
        yield from path.glob(f"{SIMULATIONS}/*.yaml")


def _wind_files(project: _Project, folder: Path) -> Path:
    """Return the path of a GADEN project's wind files without _0.csv at the end."""
    wind, place = project.config.get("unprocessed_wind_files"), project.home
    if not project.new:
        wind, place = project.sim.get("wind_sim_path"), project.home / "wind_simulations"
        given = project.sim.get("wind_data") or (project.config.get("wind_files") if wind is None else None)
        if isinstance(given, str) and "$(var wind_sim_path)" not in given:
            wind = given
            place = project.home
        elif wind is None:  # the launch file gives it; only one wind may exist
            files = sorted(place.glob("**/*_0.csv"))
            if len(files) == 1:
                wind = str(files[0]).removesuffix("_0.csv")
            elif files:
                names = ", ".join(str(file.relative_to(place)).removesuffix("_0.csv") for file in files[:10])
                raise project.wrong(f"wind_sim_path: is missing; set it to one of the winds {names}")
    if not isinstance(wind, str) or not wind:
        raise project.wrong("names no wind files; set unprocessed_wind_files, or wind_sim_path")
    for end in ("_0.csv", "", ".csv") if place == project.home else ():
        file, remark = gaden_models.located(project.listing, wind + end)
        if os.path.isfile(file):
            if remark:
                project.note(f"its wind {remark}")
            return Path(os.path.relpath(str(file).removesuffix(end), folder))
    return Path(os.path.relpath(place / wind, folder))


def _wind(project: _Project, folder: Path) -> dict[str, Any]:
    """Return files, interval and loop of the scenario's `wind`."""
    stem = _wind_files(project, folder)
    if project.flag("uniformWind", project.config):
        names = (str(stem), f"{stem}_0.csv", f"{stem}.csv")
        file = next((name for name in names if (folder / name).is_file()), names[1])
        fault = unopenable(folder / file)
        if fault:
            raise project.wrong(f"its uniform wind {file} {fault}")
        try:
            count = len(gaden_winds.uniform(folder / file))
        except WindFileError as error:
            raise ScenarioError([f"gaden: {error}"]) from None
        project.note(
            "its wind is uniform, also in walls; here the flow goes around the walls, free of divergence"
        )
    else:
        fault = unopenable(folder / f"{stem}_0.csv")
        if fault:
            raise project.wrong(f"its wind {stem.name}_0.csv {fault}")
        file = f"{stem}_%d.csv"
        count = next(n for n in itertools.count(1) if not os.path.isfile(folder / f"{stem}_{n}.csv"))
    interval = project.number("wind_step")
    return {"files": file, "interval": interval} | _loop(project, count, interval)


def _loop(project: _Project, count: int, interval: float) -> dict[str, Any]:
    """Return the keys of the wind's loop; count: number of wind files, interval: time between them [s]."""
    loop = next((project.sim[key] for key in ("windLooping", "wind_looping") if key in project.sim), None)
    if isinstance(loop, bool):
        loop = {"loop": loop}
    if isinstance(loop, dict):
        given = project.flag("loop", loop), loop.get("from", 0), loop.get("to", count - 1)
    elif loop is None and not project.new:
        if "allow_looping" not in project.sim:
            project.note(f"states no loop of its wind ({PARAMETERS[0]}: allow_looping); none is assumed")
        given = (
            project.flag("allow_looping"),
            project.sim.get("loop_from_step", 1),
            project.sim.get("loop_to_step", 100),
        )
    elif loop is None:
        return {"loop": False}
    else:
        raise project.wrong(f"the loop of its wind: got {loop!r}, must be a mapping with loop, from and to")
    is_looped, first, last = given
    numbers = [gaden_models.number(x, 0, 1e9) for x in (first, last)]
    if None in numbers:
        raise project.wrong(f"the loop of its wind: got {first!r} to {last!r}, must be numbers of files")
    if not is_looped or count == 1:
        return {"loop": False}
    begin, end = (int(x or 0) for x in numbers)
    if begin > end or end >= count:
        what = f"the loop of its wind goes from file {begin} to file {end}, but it has the files 0 to {count - 1}"
        if begin >= min(end, count):
            project.note(f"{what}; nothing is looped, the last file holds")
            return {"loop": False}
        how = "GADEN 3 loops none of them" if project.new else "GADEN 2 holds the last of them in between"
        project.note(f"{what}; here it ends at the last ({how})")
        end = count - 1
    keys: dict[str, Any] = {"loop": True}
    if begin > 0:
        keys["loop_from"] = begin * interval
    if end < count - 1:
        keys["loop_to"] = end * interval
    return keys


def _scenario(project: _Project, folder: Path, corner: np.ndarray | None) -> dict[str, Any]:
    """Return scenario data for a GADEN project. corner: lower corner of the domain [m], by default of the room."""
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
    duration = project.number("duration") or project.number("iterations") * project.number("step")
    wind |= {"kind": "imported", **_wind(project, folder), "origin": [float(x) for x in low]}
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
    name, number = str(kind).lower(), gaden_models.number(kind, 0, len(GASES) - 1)
    if number is not None and number.is_integer():
        name = GASES[int(number)]
    if name not in GASES:
        named = ", ".join(GASES)
        raise project.wrong(
            f"gasType: got {kind!r}, must be a number from 0 to {len(GASES) - 1} or one of {named}"
        )
    sigma, rate, step = project.number("sigma") / 100.0, project.number("rate"), project.number("step")
    if not sigma or not rate or not step:
        raise project.wrong("its filaments need a size, a rate and a time step above 0")
    species, remark = species_of(name)
    molar_mass = SPECIES[species].molar_mass if isinstance(species, str) else species["molar_mass"]
    if remark:
        project.note(remark)
    rate *= _released(project)
    moles = project.number("ppm") * 1e-6 * project.number("pressure") * ATM
    moles *= (2.0 * pi) ** 1.5 * sigma**3 / (GAS_CONSTANT * max(project.number("temperature"), 1.0))
    # diffusivity of the filament's random steps: see docs/coming-from/gaden.md
    noise = project.number("noise")
    diffusivity = 50.0 * noise**2 * step if project.new else 0.5 * noise**2 / step
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


def species_of(name: str) -> tuple[str | dict[str, Any], str]:
    """Return the key `species` of a gas of GADEN, and a remark on what is assumed; "" for none."""
    if name in SPECIES:
        return name, ""
    mass = GRAVITIES[name] * AIR_MOLAR_MASS
    remark = (
        f"{name} has no molar mass in GADEN; {1000.0 * mass:.4g} g/mol by its specific gravity {GRAVITIES[name]} and a "
        f"diffusivity of {DIFFUSIVITY:g} m2/s are assumed"
    )
    return {"name": name, "molar_mass": mass, "diffusivity": DIFFUSIVITY}, remark


def _released(project: _Project) -> float:
    """Return the share of num_filaments_sec that GADEN 2 releases on average.

    With variable_rate it draws the number in each step evenly between 0 and the full number. Otherwise it releases
    filaments in one of filament_stop_steps + 1 steps.
    """
    if project.new:
        return 1.0
    steps = project.number("stop_steps")
    if project.flag("variable_rate"):
        project.note(
            "variable_rate: GADEN 2 draws each step's filaments between 0 and all; here half of them, evenly"
        )
        return 0.5
    if steps:
        project.note(
            f"filament_stop_steps: GADEN 2 releases in one of {steps + 1:g} steps; here at their mean rate, evenly"
        )
    return 1.0 / (1.0 + steps)
