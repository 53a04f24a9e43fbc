"""The scenario: all sections of an experiment as frozen pydantic models, in SI units.

``python -m taichi_plume.scenario --schema`` prints the JSON schema for editors. `loading` reads YAML; `checks` collects
the errors and warnings of all sections.
"""

from collections.abc import Iterator, Mapping
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import ConfigDict, Field, field_validator

from taichi_plume.quantities import fault
from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Arena, Context, Domain
from taichi_plume.scenario.gases import AnySource, Gas, PureGas
from taichi_plume.scenario.heat import Buoyancy, Heat
from taichi_plume.scenario.maps import Map
from taichi_plume.scenario.obstacles import Obstacle
from taichi_plume.scenario.openings import Opening
from taichi_plume.scenario.outputs import Checkpoint, Fields, Forces, Output, PlumeLog, Recording
from taichi_plume.scenario.policy import Policy
from taichi_plume.scenario.probes import Probes
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.screens import AnyScreen
from taichi_plume.scenario.starts import too_close
from taichi_plume.scenario.task import Task
from taichi_plume.scenario.team_algorithms import too_many_messages
from taichi_plume.scenario.vocabulary import AT_START, SHAPE, FileName, Model
from taichi_plume.scenario.winds import Wind

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taichi_plume.scenario.checks import Check
    from taichi_plume.scenario.loading import Overrides

MOST_TICKS = 2e9  # kernels count them in 32 bits


class Origin(NamedTuple):
    """Origin of a scenario: its folder, its YAML file if it has one; notes and files of a GADEN project."""

    folder: Path = Path()
    file: Path | None = None
    notes: tuple[str, ...] = ()
    gaden: tuple[Path, ...] = ()


def _or_a_project(schema: dict[str, Any]) -> None:
    """Make the required keys optional in the JSON schema if the file names a project of GADEN."""
    schema["anyOf"] = [{"required": schema.pop("required")}, {"required": ["gaden"]}]


class Scenario(Model):
    """An experiment: all data that decide the outcome."""

    model_config = ConfigDict(json_schema_extra=_or_a_project)

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")] = "run"
    """Name of the experiment, and of the folders of its runs. Letters, digits, dot, underscore and dash."""
    seed: Annotated[int, Field(ge=0, lt=2**32), AT_START] = 0
    """Seed of all random numbers: the same seed makes the same run. Another one draws other eddies, noise and start
    positions."""
    air_seed: Annotated[int, Field(ge=0, lt=2**32), AT_START] | None = None
    """Seed of wind and gas alone; unless given, `seed`. With the same air_seed and another seed, robots with other
    starts and noise search in the same air."""
    gaden: FileName | None = None
    """Path of a project of GADEN, or of one of its simulations, in a scenario's file. Room, wind, source and gas are
    taken from it; keys of the scenario take precedence."""
    duration: si.Duration
    """Time for which robots move and sensors measure, after the warm-up. The air should pass the room several times."""
    warm_up: Annotated[si.Delay, AT_START] = 0.0
    """Time before the robots start, for flow and gas to develop. The clock then shows negative times, up to 0; the
    air should pass the room a few times."""
    tick: Annotated[si.Tick, SHAPE] = 0.1
    """Control period: once per tick sensors measure and robots decide. The air takes as many shorter steps as it
    needs."""
    stop_early: bool = True
    """End the run once no robot of any group searches any more. Each robot has then found a source or, if that ends the
    search, declared one. With false the run lasts the whole duration, as for maps and measurements."""
    domain: Domain
    """The box of air that is simulated, with its lower corner at the origin, and its grid."""
    wind: Wind
    """Motion of the air: computed, uniform, random eddies, or from files."""
    obstacles: tuple[Obstacle, ...] = ()
    """Bodies that air and gas go around and robots cannot pass: boxes, cylinders, spheres, prisms, meshes."""
    gas: Gas
    """Gas in the air: its species, its dispersion model and its sources."""
    arena: Arena | None = None
    """Part of the floor that the robots may use; unless given, all of it."""
    robots: tuple[Group, ...] = ()
    """Groups of robots, each with its body, sensors and search algorithm. Without any, air and gas alone are
    simulated."""
    rivals: bool = False
    """Whether each group searches as if the others were absent, which compares algorithms in the same air. Otherwise
    the groups share the floor."""
    maps: tuple[Map, ...] = ()
    """Gas maps made online from the robots' readings, and scored against the mean of the true gas."""
    recording: Recording = Recording()
    """Recording for the viewer, in recording.rrd, and as numbers in pictures.zarr."""
    forces: Forces = Forces()
    """Interval at which the force of the air on each obstacle is written to forces.csv."""
    probes: Probes | None = None
    """Points at which wind, pressure, gas and temperature are written to probes.parquet; unless given, none."""
    fields: Fields | None = None
    """Whole wind and gas fields over time, in fields.zarr: to look at or to play back; unless given, none."""
    outputs: tuple[Output, ...] = ()
    """Views written besides the recording, each at its own rate, as groups of pictures.zarr."""
    plumesim_log: PlumeLog | None = None
    """Wind and gas as a log of PlumeSim, in plume.pslog; unless given, none is written."""
    task: Task = Task()
    """The scenario as a task to learn: episodes, airs, rewards. Runs ignore it."""
    checkpoint: Checkpoint | None = Checkpoint()
    """Interval of checkpoints, from which an interrupted run can be resumed. null: never."""

    @field_validator("gaden")
    @classmethod
    def _only_in_files(cls, value: str | None) -> str | None:
        if value is not None:
            raise fault("works in the file of a scenario alone; in Python use load_scenario")
        return value

    @property
    def origin(self) -> "Origin":
        """File and folder from which the scenario was read; by default the working folder."""
        return vars(self).get("_origin", Origin())

    def from_origin(self, origin: "Origin") -> Self:
        """Return a copy of the scenario with another `origin`."""
        copy = super().model_copy()
        vars(copy)["_origin"] = origin
        return copy

    def model_copy(self, *, update: Mapping[str, object] | None = None, deep: bool = False) -> Self:
        return super().model_copy(update=update, deep=deep).from_origin(self.origin)

    def keys_set(self) -> dict[str, Any]:
        """Return the keys that were set, without defaults, in the types of YAML and in SI units."""
        return self.model_dump(mode="json", exclude_unset=True)

    def with_(self, changes: Mapping[str, object]) -> "Scenario":
        """Return a copy of the scenario with new values at paths of keys, such as ``{"robots.0.count": 3}``.

        Values are as in YAML: numbers, texts such as "5 cm", lists, dicts. Raises ScenarioError, a line for each fault.

        >>> import taichi_plume as tp
        >>> tp.Scenario.from_file("casting_room").with_({"domain.spacing": "5 cm"}).domain.spacing
        0.05
        """
        from taichi_plume.scenario.loading import of_python, scenario_of  # it imports this module

        return scenario_of(self.keys_set(), of_python(changes)).from_origin(self.origin)

    if TYPE_CHECKING:  # `api/scenario.py` attaches these

        @classmethod
        def from_file(cls, path: str | Path, overrides: Overrides = ()) -> "Scenario": ...
        @classmethod
        def from_dict(cls, data: Mapping[str, object], folder: str | Path = ".") -> "Scenario": ...
        def to_yaml(self, path: str | Path | None = None, defaults: bool = False) -> str: ...
        def check(self, allow_outside: bool = False) -> Check: ...
        def plot(
            self, allow_outside: bool = False, *, ax: Axes | None = None,
            figsize: tuple[float, float] | None = None,
        ) -> Figure: ...  # fmt: skip

    @property
    def floor(self) -> Arena:
        """Rectangle of floor that the robots may use: the arena, by default the whole floor."""
        width, length = self.domain.extent[:2]
        return self.arena or Arena(low=(0.0, 0.0), high=(width, length))

    @property
    def gases(self) -> tuple[tuple[str, PureGas], ...]:
        """All gases of a single species with their paths in the scenario, such as ``gas.parts[0]``."""
        return self.gas.alone("gas")

    @property
    def backgrounds(self) -> dict[str, float]:
        """Concentration of each species in clean air [ppm], by the name of the species; see `OneGas.background`."""
        known: dict[str, float] = {}
        for _, gas in self.gases:
            known[gas.vapour.name] = max(known.get(gas.vapour.name, 0.0), gas.background or 0.0)
        return known

    def with_gases(self, others: Mapping[str, PureGas]) -> "Scenario":
        """Return a copy of the scenario in which the gases at the paths in `others` are replaced."""
        if not others:
            return self
        return self.model_copy(update={"gas": self.gas.replaced("gas", others)})

    @property
    def believers(self) -> tuple[Group, ...]:
        """Groups of robots that estimate the source's position as a probability distribution (belief)."""
        return tuple(group for group in self.robots if group.algorithm.believes)

    @property
    def seed_of_air(self) -> int:
        """Seed of the random numbers of wind and gas: `air_seed`, by default `seed`."""
        return self.seed if self.air_seed is None else self.air_seed

    @property
    def seeds(self) -> dict[str, int]:
        """Seeds for the report of a run: `seed` and, if given, `air_seed`."""
        return {"seed": self.seed} | ({} if self.air_seed is None else {"air_seed": self.air_seed})

    @property
    def air_by_chance(self) -> bool:
        """Whether wind or gas differ from seed to seed."""
        return self.wind.by_chance or self.gas.by_chance or any(group.wake for group in self.robots)

    @property
    def openings(self) -> tuple[Opening, ...]:
        """Openings (inlets, outlets, walls) of the flow if it is computed; otherwise none."""
        return self.wind.computed.openings if self.wind.computed else ()

    def passes_edge(self, axis: int, side: int, along: np.ndarray, width: float) -> np.ndarray:
        """Return whether air passes an edge of the floor within `width` around positions (n,) along it [m], (n,).

        axis: normal to the edge (0: x, 1: y); side: 0 at the origin, 1 at the other end. In 3-D an opening counts at
        the height of the first group's anemometer. Winds without walls pass everywhere.
        """
        if self.wind.computed is None and not self.wind.walled:
            return np.ones(len(along), bool)
        passes = np.zeros(len(along), bool)
        height = self.robots[0].sensors.wind.height if self.robots else 0.0
        for opening in self.openings:
            region = opening.region
            if opening.wraps == "xy"[axis]:
                passes[:] = True
            elif region is not None and opening.passes and (region.axis, region.side) == (axis, side):
                center, half = region.rectangle(self.domain.extent)
                if len(center) == 1 or abs(height - center[1]) <= half[1]:
                    overlap = half[0] + 0.5 * width - np.abs(along - center[0])
                    passes |= overlap > 0.5 * min(width, 2.0 * half[0])
        return passes

    @property
    def screens(self) -> tuple[AnyScreen, ...]:
        """Return the permeable screens of a computed flow; other winds have none."""
        return self.wind.computed.screens if self.wind.computed else ()

    @property
    def buoyancy(self) -> Buoyancy | None:
        """Settings of buoyancy if the flow is computed with it; otherwise None."""
        return self.wind.computed.buoyancy if self.wind.computed else None

    @property
    def heat(self) -> Heat | None:
        """Settings of the air temperature, heaters and warm walls if it is computed; otherwise None."""
        return self.buoyancy.heat if self.buoyancy else None

    @property
    def sources(self) -> tuple[tuple[str, AnySource], ...]:
        """All sources of all gases with their paths in the scenario, such as ``gas.sources[0]``."""
        return tuple(
            (f"{path}.{gas.sources_key}[{n}]", source)
            for path, gas in self.gases
            for n, source in enumerate(gas.sources)
        )

    @property
    def sources_change(self) -> bool:
        """Whether any source moves, appears after the start of the robots, ends, or is not searched for."""
        return not all(gas.searched for _, gas in self.gases) or any(
            vars(source).get("motion") is not None or source.on[0] > 0.0 or source.on[1] < np.inf
            for _, source in self.sources
        )

    @property
    def rates(self) -> np.ndarray:
        """Mean rates of all sources while they are there (m,) [kg/s], in the order of `sources`; NaN if unknown."""
        return np.array([source.mean_rate for _, source in self.sources], float)

    def targets_at(self, t: float | np.ndarray) -> np.ndarray:
        """Return positions like `sources_at`, with NaN also for the sources of gases that are not searched for."""
        searched = np.array([gas.searched for _, gas in self.gases for _ in gas.sources], bool)
        return np.where(searched[:, None], self.sources_at(t), np.nan)

    def sources_at(self, t: float | np.ndarray) -> np.ndarray:
        """Return the positions of all sources (..., m, dim) [m] at times t (...) [s], in the order of `sources`.

        NaN for a source that has not started or has ended. A source that pulses is there during its pauses, too.

        >>> import taichi_plume as tp
        >>> path = {"path": [[10, 2.0, 1.0]]}
        >>> room = tp.Scenario.from_file("casting_room").with_({"gas.sources.0.motion": path})
        >>> room.sources_at(20.0).tolist()
        [[2.0, 1.0]]
        """
        t = np.asarray(t, float)
        places = np.full((*t.shape, len(self.sources), self.domain.dim), np.nan)
        for n, (_, source) in enumerate(self.sources):
            start, stop = source.on
            places[..., n, :] = np.where(((start < t) & (t <= stop))[..., None], source.places(t), np.nan)
        return places

    @property
    def learners(self) -> Group:
        """Group of robots that learns in environments: the first with a policy, or else the first, with a new policy.

        Raises ValueError where the scenario has no robots.
        """
        if not self.robots:
            raise ValueError("robots: the scenario has none; a task to learn needs a group of robots")
        for group in self.robots:
            if isinstance(group.algorithm, Policy):
                return group
        return self.robots[0].model_copy(update={"algorithm": Policy(kind="policy")})

    @property
    def first_tick(self) -> int:
        """Number of the run's first control period: minus the number of those in the warm-up."""
        return -ceil(self.warm_up / self.tick - 1e-9)

    @property
    def last_tick(self) -> int:
        """Number of the run's last control period: the duration in control periods, rounded up."""
        return ceil(self.duration / self.tick - 1e-9)

    def dimension_errors(self, where: str, dim: int) -> Iterator[str]:
        ticks = (self.warm_up + self.duration) / self.tick
        if ticks > MOST_TICKS:
            yield f"tick: {self.tick:g} s makes {ticks:.3g} ticks, at most {MOST_TICKS:g} are counted; raise it"
        yield from super().dimension_errors(where, dim)

    def errors(self, where: str, context: Context) -> Iterator[str]:
        first: dict[str, int] = {}
        names: list[tuple[str, int]] = []
        discs: list[tuple[np.ndarray, float]] = []
        sound = self.arena is None or self.arena.fault(self.domain.extent) is None
        for n, group in enumerate(self.robots):
            if (m := first.setdefault(group.name, n)) != n:
                yield f"robots[{n}].name: '{group.name}' is the name of robots[{m}] too; give each group its own"
            places = group.places(self.floor) if sound else None
            if places is not None:
                names += [(f"robots[{n}]", k) for k in range(group.count)]
                discs.append((places, group.body.radius))
            if discs and (self.rivals or n == len(self.robots) - 1):
                yield from too_close(names, discs)
                names, discs = [], []
        yield from self._too_many_messages()

    def _too_many_messages(self) -> Iterator[str]:
        """Yield an error if the robots' messages of all groups together are too many, but those of no single group."""
        talking = [(f"robots[{n}]", group) for n, group in enumerate(self.robots) if group.algorithm.talks]
        alone = any(line for where, group in talking for line in too_many_messages(where, [group]))
        if len(talking) > 1 and not alone:
            yield from too_many_messages(talking[-1][0], [group for _, group in talking])
