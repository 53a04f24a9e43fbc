"""Opened files of a scenario. Each kind of section that names a file has an opener here."""

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from taichi_plume.files.conventions import FileFacts
from taichi_plume.files.gas_classes import ClassifierError, TrainedClassifier, trained
from taichi_plume.files.network import Network
from taichi_plume.files.own_class import CLASSES, Code, LawFile, OwnAlgorithmError, OwnFile, Permission
from taichi_plume.files.point_frames import PointFileError, PointFrames, frames_of
from taichi_plume.files.prior_map import PriorError, PriorMap
from taichi_plume.files.ros_robots import MapFrame
from taichi_plume.grid.shapes import Shape
from taichi_plume.scenario.algorithms import Own
from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.external import Replay
from taichi_plume.scenario.gas_classes import AnyClassifier, NearestClassifier, OnnxClassifier
from taichi_plume.scenario.gases import PlaybackGas, PureGas
from taichi_plume.scenario.imported_wind import ImportedWind
from taichi_plume.scenario.initial_conditions import InitialGas, InitialWind
from taichi_plume.scenario.own_code import OwnCode, OwnGas, OwnLaw, OwnWind
from taichi_plume.scenario.playback import (
    GadenGas,
    MovieGas,
    Playback,
    PlaybackWind,
    PlumeSimLog,
    PlumeSimWind,
    played_source,
)
from taichi_plume.scenario.plumesim import FluentGas, PlumeSimGas
from taichi_plume.scenario.policy import Policy
from taichi_plume.scenario.prior import Prior
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.vocabulary import Model

if TYPE_CHECKING:  # they bring zarr and Taichi, for runs that need them
    from taichi_plume.files.film import Film
    from taichi_plume.files.gaden_film import GadenFilm
    from taichi_plume.files.movie import Movie
    from taichi_plume.files.trajectories import Way
    from taichi_plume.files.wind_site import Site
    from taichi_plume.grid.cut_cells import Air


OPENED = (
    "files",
    "facts",
    "shapes",
    "films",
    "frames",
    "movies",
    "gaden_films",
    "code",
    "networks",
    "ways",
    "priors",
    "classifiers",
    "gases",
)
"""Attributes of `Resources` with the contents of files, by the paths of the sections."""


@dataclass
class Resources:
    """Contents of a scenario's files, each opened once, by the paths of the sections that name them.

    faults: errors of files, by the paths of the keys that name them. files: paths that were opened for each section,
    also by other files, and for `gaden`. facts: what was read of the files of each section.
    shapes: of the obstacles, in their order. site: files of an imported wind.
    code: files of own algorithms and laws; own: their classes and functions, once executed. networks: of policies.
    ways: paths of recorded robots. priors: of searches. classifiers: of gases.
    gases: played-back gases, completed by their films. warnings: results of the checks. sections: all that were opened.
    folder, allow_outside, named, allow_code: permissions, see `preparation.again`.
    """

    scenario: Scenario
    folder: Path = Path()
    allow_outside: bool = False
    named: Collection[str] = ()
    allow_code: Permission = False
    sections: dict[str, Model] = field(default_factory=dict)
    faults: dict[str, str] = field(default_factory=dict)
    files: dict[str, list[Path]] = field(default_factory=dict)
    facts: dict[str, FileFacts] = field(default_factory=dict)
    shapes: dict[str, Shape] = field(default_factory=dict)
    films: "dict[str, Film]" = field(default_factory=dict)
    frames: dict[str, PointFrames] = field(default_factory=dict)
    movies: "dict[str, Movie]" = field(default_factory=dict)
    gaden_films: "dict[str, GadenFilm]" = field(default_factory=dict)
    site: "Site | None" = None
    code: dict[str, OwnFile] = field(default_factory=dict)
    own: dict[str, Code] = field(default_factory=dict)
    networks: dict[str, Network] = field(default_factory=dict)
    ways: "dict[str, list[Way]]" = field(default_factory=dict)
    priors: dict[str, PriorMap] = field(default_factory=dict)
    classifiers: dict[str, TrainedClassifier] = field(default_factory=dict)
    gases: dict[str, PureGas] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    _unlike: dict[Path, int] = field(default_factory=dict, repr=False)
    _site_air: "dict[bool, Air]" = field(default_factory=dict, repr=False)

    def take_over(self, path: str, section: Model, other: "Resources | None") -> bool:
        """Take over what was opened for an equal section of another scenario; return whether there is one."""
        self.sections[path] = section
        if other is None or other.scenario.domain != self.scenario.domain:
            return False
        if section not in (other.sections.get(path), other.gases.get(path)):
            return False
        for name in OPENED:
            opened = vars(other)[name]
            if path in opened:
                vars(self)[name][path] = opened[path]
        if isinstance(section, ImportedWind):
            self.site = other.site
        return True

    def code_of(self, path: str, section: OwnCode) -> Code | None:
        """Return the class or function of the section at `path`, executed or given by Python code; None if missing."""
        given = None if section.file else CLASSES.get(section.name or "")
        code = self.own.get(path, given)
        return code if isinstance(code, type) != isinstance(section, OwnLaw) else None

    @property
    def context(self) -> Context:
        """Data for the checks of sections."""
        return Context(self.scenario, self.shapes)

    @property
    def obstacles(self) -> list[Shape]:
        """Shapes of all obstacles of the scenario, in their order."""
        return list(self.shapes.values())

    @property
    def standing(self) -> list[Shape | None]:
        """Shape of each obstacle that stands still, None for each moving obstacle."""
        return [shape if shape.model.motion is None else None for shape in self.shapes.values()]

    def recorded_paths(self, path: str) -> "list[Way]":
        """Recorded paths of the replay section at `path`, in the coordinates of the domain."""
        ways = self.ways[path]
        return [way.moved(origin) for way, origin in zip(ways, self.origins(path), strict=True)]

    def origins(self, path: str) -> list[tuple[float, float]]:
        """Position [m] in the domain of the origin of the frame of each recorded path, see `recorded_paths`."""
        model, frame = self.sections[path], MapFrame.of(self.scenario, self.obstacles)
        assert isinstance(model, Replay)
        return [model.origin or frame.origin_of(way.frame) for way in self.ways[path]]

    def unlike(self, path: str) -> int:
        film = self.films[path]
        if film.path not in self._unlike:
            from taichi_plume.grid.cut_cells import air_of
            from taichi_plume.grid.grid import Grid

            recorded = film.still("volume")
            here = air_of(self.standing, Grid.of(self.scenario.domain, film.periodic), recorded > 0)
            self._unlike[film.path] = int((np.abs(here.volume - recorded) > 0.01).sum())
        return self._unlike[film.path]

    def solid(self) -> np.ndarray:
        """Cells of an imported wind's grid without air; outlets, which lie in the walls, count as walls."""
        return self.site_air(outlets=False).solid

    def site_air(self, outlets: bool = True) -> "Air":
        """The air of an imported wind; outlets: whether outlets of the occupancy grid count as air."""
        assert self.site is not None
        cubes = self.site.cubes
        key = outlets or cubes is None or not cubes.outlet.any()
        if key not in self._site_air:
            from taichi_plume.grid.cut_cells import air_of
            from taichi_plume.grid.grid import Grid

            grid = Grid.of(self.scenario.domain)
            left = cubes.shares(grid, outlets) if cubes else None
            self._site_air[key] = air_of(self.standing, grid, left=left)
        return self._site_air[key]


@contextmanager
def _reported(resources: Resources, path: str, error: type[Exception]) -> Iterator[None]:
    """Catch exceptions of class `error` in the block and record their text as the fault of the key `path`."""
    try:
        yield
    except error as fault:
        resources.faults[path] = str(fault)


def _opened(resources: Resources, file: Path) -> "Film":
    """Return the open film (recorded flow and gas) of a file, opened once for all sections. Raises FilmError."""
    from taichi_plume.files.film import Film

    film = next((film for film in resources.films.values() if film.path == file), None) or Film(file)
    film.still("volume")
    return film


def _film(resources: Resources, path: str, model: Playback, folder: Path) -> PureGas | None:
    """Open the film of a section; return a played-back gas with the recorded species and sources, else None."""
    from taichi_plume.files.film import FilmError

    with _reported(resources, f"{path}.file", FilmError):
        film = _opened(resources, folder / model.file)
        gas = completed(model, film) if isinstance(model, PlaybackGas) else None
        for n in {0, len(film.times) - 1}:
            film.frame(n, film.wind if model.part == "wind" else film.gas)
        resources.films[path], resources.facts[path] = film, film.facts()
        return gas
    return None


def _moment(resources: Resources, path: str, model: InitialWind | InitialGas, folder: Path) -> None:
    """Open the film that gives the initial wind or gas and read the frames at the chosen time."""
    if model.film is None:
        return
    from taichi_plume.files.film import FilmError

    with _reported(resources, f"{path}.film", FilmError):
        film = _opened(resources, folder / model.film)
        names = film.wind
        if model.part == "gas":
            gas = dict(resources.scenario.gases)[path.removesuffix(".initial")]
            names = [film.gas_of(gas.species)] if film.gas else []
        film.moment(names, model.at)
        resources.films[path], resources.facts[path] = film, film.facts()


def completed(gas: PlaybackGas, film: "Film") -> PlaybackGas:
    """Return a played-back gas; species, sources and background not given come from the film. Raises FilmError."""
    from taichi_plume.files.film import FilmError

    if gas.sources and gas.species and gas.background is not None:
        return gas
    try:
        recorded = film.attributes["gases"][film.gas_of(gas.species)] if film.gas else {}
        if "sources" in recorded:
            played = [played_source(source, film.times, gas) for source in recorded["sources"]]
            recorded = recorded | {"sources": played}
        given = gas.model_dump(exclude_none=True, exclude_defaults=True)
        return PlaybackGas.model_validate(recorded | given | {"kind": "playback"})
    except (ValidationError, LookupError, TypeError):
        raise FilmError(f"{film.path}: is damaged: its species or sources are invalid") from None


def _points(
    resources: Resources, path: str, model: PlumeSimWind | PlumeSimGas | FluentGas, folder: Path
) -> None:
    """Read the point frames (values at scattered points) of a section; a log that sections share is read once."""
    with _reported(resources, f"{path}.{model.key}", PointFileError):
        file = folder / model.file if isinstance(model, PlumeSimLog) else None
        known = (frames for frames in resources.frames.values() if frames.path == file)
        resources.frames[path] = next(known, None) or frames_of(model, folder)
        resources.facts[path] = resources.frames[path].facts


def _movie(resources: Resources, path: str, model: MovieGas, folder: Path) -> None:
    """Open the movie (gas concentrations over time, y, x) and read its first and last frame."""
    from taichi_plume.files.film import FilmError
    from taichi_plume.files.movie import Movie

    with _reported(resources, f"{path}.file", FilmError):
        movie = Movie(folder / model.file, model, resources.scenario.domain)
        for n in {0, len(movie.times) - 1}:
            movie.picture(n)
        resources.movies[path], resources.facts[path] = movie, movie.facts()


def _gaden(resources: Resources, path: str, model: GadenGas, folder: Path) -> PureGas | None:
    """Open results of GADEN and read the first and last file; return the gas with their species and source."""
    from taichi_plume.files.film import FilmError
    from taichi_plume.files.gaden_film import GadenFilm
    from taichi_plume.files.gaden_project import species_of

    with _reported(resources, f"{path}.files", FilmError):
        film = GadenFilm(folder, model, resources.scenario.domain)
        for n in {0, len(film.times) - 1}:
            film.frame(n, ["concentration"])
        given = model.model_dump(exclude_none=True, exclude_unset=True)
        species, remark = species_of(film.gas)
        if "species" not in given:
            film.remarks += [remark] if remark else []
        elif model.vapour.name != film.gas:
            film.remarks.append(
                f"{film.path}: is of {film.gas}; its ppm are taken as those of {model.vapour.name}"
            )
        found = {"species": species, "sources": [{"position": film.source}]}
        resources.gaden_films[path], resources.facts[path] = film, film.facts()
        return GadenGas.model_validate(found | given)
    return None


def _site(resources: Resources, path: str, model: ImportedWind, folder: Path) -> None:
    """Read the first and the last file of an imported wind."""
    from taichi_plume.files.wind_points import WindFileError
    from taichi_plume.files.wind_site import Site

    with _reported(resources, f"{path}.files", WindFileError):
        site = Site(model, resources.scenario.domain.extent, folder)
        site.read(site.files[-1][1])
        resources.site, resources.facts[path] = site, site.facts()


def _own(resources: Resources, path: str, model: Own, folder: Path) -> None:
    """Read the Python file of a user's algorithm; without a file the class is passed to `assemble`."""
    if model.file:
        with _reported(resources, f"{path}.file", OwnAlgorithmError):
            resources.code[path] = OwnFile.read(folder / model.file, model.name)


def _law(resources: Resources, path: str, model: OwnLaw, folder: Path) -> None:
    """Read the Python file of a user's law; without a file the function is passed to `assemble`."""
    if model.file:
        with _reported(resources, f"{path}.file", OwnAlgorithmError):
            resources.code[path] = LawFile.read(folder / model.file, model.name or model.function)


def _network(resources: Resources, path: str, model: Policy, folder: Path) -> None:
    """Read the neural network of a policy; without a file the policy is not trained yet and nothing is read."""
    if model.file:
        with _reported(resources, f"{path}.file", OwnAlgorithmError):
            resources.networks[path] = Network.read(folder / model.file)


def _ways(resources: Resources, path: str, model: Replay, folder: Path) -> None:
    """Read the recorded trajectories of the robots of a replay section."""
    from taichi_plume.files.bag_readings import BagOptions
    from taichi_plume.files.trajectories import WayError, facts, read

    with _reported(resources, f"{path}.file", WayError):
        options = BagOptions(
            model.topics, model.poses, frame=model.frame, units=model.units, reading=model.readings
        )
        resources.ways[path] = read(folder / model.file, options)
        resources.facts[path] = facts(resources.ways[path], resources.origins(path))


def _prior(resources: Resources, path: str, model: Prior, folder: Path) -> None:
    """Read the weights of a prior, from its file or its section, and check that some of them lie in the room."""
    try:
        resources.priors[path] = PriorMap(model, resources.scenario.floor, folder)
    except PriorError as error:
        resources.faults[f"{path}.{error.key}"] = str(error)


def _classifier(resources: Resources, path: str, model: AnyClassifier, folder: Path) -> None:
    """Read or train the classifier of gases of a group's robots."""
    group = path.removesuffix(".sensors.classifier")
    sensors = next(
        each.sensors for n, each in enumerate(resources.scenario.robots) if group == f"robots[{n}]"
    )
    gases = sorted({gas.vapour.name for _, gas in resources.scenario.gases})
    try:
        resources.classifiers[path] = trained(model, sensors, gases, folder)
    except ClassifierError as error:
        resources.faults[f"{path}.{error.key}"] = str(error)


OPENERS: dict[type[Model], Callable[[Resources, str, Any, Path], PureGas | None]] = {
    PlaybackWind: _film,
    PlaybackGas: _film,
    PlumeSimWind: _points,
    PlumeSimGas: _points,
    FluentGas: _points,
    MovieGas: _movie,
    GadenGas: _gaden,
    ImportedWind: _site,
    InitialWind: _moment,
    InitialGas: _moment,
    Prior: _prior,
    NearestClassifier: _classifier,
    OnnxClassifier: _classifier,
    Own: _own,
    OwnGas: _law,
    OwnWind: _law,
    Policy: _network,
    Replay: _ways,
}
