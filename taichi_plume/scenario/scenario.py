"""The whole scenario vocabulary as frozen pydantic models. SI units; see `quantities` for texts with units.

``python -m taichi_plume.scenario --schema`` prints the JSON schema for editors. What is wrong with a section beyond
single keys the section tells itself, see `checks`; `loading` reads YAML.
"""

from collections.abc import Iterator, Mapping
from math import ceil
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field, field_validator

from taichi_plume.scenario.domain import Arena, Context, Domain
from taichi_plume.scenario.gases import AnySource, Gas, PureGas
from taichi_plume.scenario.heat import Buoyancy
from taichi_plume.scenario.maps import Map
from taichi_plume.scenario.obstacles import Obstacle
from taichi_plume.scenario.openings import Opening
from taichi_plume.scenario.outputs import Checkpoint, Fields, Forces, PlumeLog, Recording
from taichi_plume.scenario.policy import Policy
from taichi_plume.scenario.probes import Probes
from taichi_plume.scenario.quantities import fault
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.screens import AnyScreen
from taichi_plume.scenario.starts import too_close
from taichi_plume.scenario.task import Task
from taichi_plume.scenario.team_algorithms import too_many_messages
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    FREE,
    Delay,
    Duration,
    FileName,
    Model,
    Tick,
)
from taichi_plume.scenario.winds import Wind

MOST_TICKS = 2e9  # kernels count them in 32 bits


def _or_a_project(schema: dict[str, Any]) -> None:
    """What a file must have, unless it names a project of GADEN's."""
    schema["anyOf"] = [{"required": schema.pop("required")}, {"required": ["gaden"]}]


class Scenario(Model):
    """One experiment: everything that decides its outcome."""

    model_config = ConfigDict(json_schema_extra=_or_a_project)

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"), FREE] = "run"
    """Name of the experiment, and of the folders of its runs. Letters, digits, dot, underscore and dash."""
    seed: Annotated[int, Field(ge=0, lt=2**32), FREE] = 0
    """Begin of all random numbers: the same seed makes the same run. Another one draws other eddies, noise and start
    places."""
    air_seed: Annotated[int, Field(ge=0, lt=2**32), FREE] | None = None
    """Begin of the random numbers of wind and gas alone; unless given, the seed. With the same one, robots of another
    seed, with other starts and noise, search in the same air."""
    gaden: Annotated[FileName, FREE] | None = None
    """Path of a project of GADEN's, or of one of its simulations, in a scenario's file. Room, wind, source and gas are
    taken from it; keys that stand beside come before."""
    duration: Duration
    """Time for which robots move and sensors measure, after the warm-up. The air should get through the room several
    times."""
    warm_up: Delay = 0.0
    """Time before the robots start, for flow and gas to develop. The clock then shows negative times, up to 0; long
    enough is when the air has gone through the room a few times."""
    tick: Annotated[Tick, COMPILED] = 0.1
    """Control period: once per tick sensors measure and robots decide. The air takes as many shorter steps in it as
    it needs."""
    stop_early: Annotated[bool, FREE] = True
    """End the run once no robot of any group searches any more. Each has found a source then or, where its search ends
    so, has declared one. With false it lasts the whole duration, as for maps and measurements."""
    domain: Domain
    """The box of air that is simulated, with its lower corner at the origin, and its grid."""
    wind: Wind
    """How the air moves: computed, the same everywhere, random eddies, or from files."""
    obstacles: tuple[Obstacle, ...] = ()
    """Bodies that air and gas go around and robots cannot pass: boxes, cylinders, spheres, prisms, meshes."""
    gas: Gas
    """What the air carries: which gas, how it disperses and where it comes from."""
    arena: Arena | None = None
    """Part of the floor that the robots may use; unless given, all of it."""
    robots: tuple[Group, ...] = ()
    """Groups of robots, each with its body, sensors and search algorithm. Without any, air and gas alone are
    simulated."""
    rivals: bool = False
    """Whether each group searches as if the others were not there. So algorithms are compared in the same air;
    otherwise the groups share the floor."""
    maps: tuple[Map, ...] = ()
    """Gas maps made online from the robots' readings, and scored against the mean of the true gas."""
    recording: Annotated[Recording, FREE] = Recording()
    """What is recorded for the viewer, in recording.rrd."""
    forces: Annotated[Forces, FREE] = Forces()
    """How often the force of the air on each obstacle is noted, in forces.csv."""
    probes: Annotated[Probes | None, FREE] = None
    """Points at which wind, pressure, gas and temperature are noted, in probes.parquet; unless given, none."""
    fields: Annotated[Fields | None, FREE] = None
    """Whole wind and gas fields over time, in fields.zarr: to look at or to play back; unless given, none."""
    plumesim_log: Annotated[PlumeLog | None, FREE] = None
    """Wind and gas as a log of PlumeSim, in plume.pslog; unless given, none is written."""
    task: Annotated[Task, FREE] = Task()
    """What the scenario is as a task to learn: episodes, airs, rewards. Runs do not look at it."""
    checkpoint: Annotated[Checkpoint | None, FREE] = Checkpoint()
    """How often the state of the run is saved, from which it can be resumed when cut off. null: never."""

    @field_validator("gaden")
    @classmethod
    def _is_carried_out(cls, value: str | None) -> str | None:
        if value is not None:
            raise fault("is carried out of a scenario's file alone; in Python by load_scenario")
        return value

    def changed(self, changes: Mapping[str, Any]) -> "Scenario":
        """Return the scenario with other values at the paths of keys, such as ``{"robots.0.count": 3}``.

        Values are as in YAML: numbers, texts such as "5 cm", lists, dicts. Raises ScenarioError, a line for each fault.
        """
        from taichi_plume.scenario.loading import of_python, scenario_of  # it imports this module

        return scenario_of(self.model_dump(mode="json", exclude_unset=True), of_python(changes))

    @property
    def floor(self) -> Arena:
        """Where robots may be."""
        width, length = self.domain.extent[:2]
        return self.arena or Arena(low=(0.0, 0.0), high=(width, length))

    @property
    def gases(self) -> tuple[tuple[str, PureGas], ...]:
        """Every gas of one species, with its path in the scenario."""
        return self.gas.alone("gas")

    def with_gases(self, others: Mapping[str, PureGas]) -> "Scenario":
        """With other gases in place of those of some paths."""
        return self.model_copy(update={"gas": self.gas.replaced("gas", others)}) if others else self

    @property
    def believers(self) -> tuple[Group, ...]:
        """Groups whose robots believe in places of the source."""
        return tuple(group for group in self.robots if group.algorithm.believes)

    @property
    def seed_of_air(self) -> int:
        """That of wind and gas."""
        return self.seed if self.air_seed is None else self.air_seed

    @property
    def seeds(self) -> dict[str, int]:
        """As runs tell them: the seed, and that of the air where it is given."""
        return {"seed": self.seed} | ({} if self.air_seed is None else {"air_seed": self.air_seed})

    @property
    def air_by_chance(self) -> bool:
        """Whether another seed makes other wind or gas."""
        return self.wind.by_chance or self.gas.by_chance or any(group.wake for group in self.robots)

    @property
    def openings(self) -> tuple[Opening, ...]:
        """Those of a computed flow."""
        return self.wind.computed.openings if self.wind.computed else ()

    @property
    def screens(self) -> tuple[AnyScreen, ...]:
        """Those of a computed flow."""
        return self.wind.computed.screens if self.wind.computed else ()

    @property
    def buoyancy(self) -> Buoyancy | None:
        """That of a computed flow."""
        return self.wind.computed.buoyancy if self.wind.computed else None

    @property
    def sources(self) -> tuple[tuple[str, AnySource], ...]:
        """Every source of every gas, with its path in the scenario."""
        return tuple(
            (f"{path}.{gas.sources_key}[{n}]", source)
            for path, gas in self.gases
            for n, source in enumerate(gas.sources)
        )

    @property
    def learners(self) -> Group:
        """The group that learns in environments: the first with a policy, or the first of all, which then gets one.

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
        """Tick at which the run begins: the warm-up in whole ticks, negative."""
        return -ceil(self.warm_up / self.tick - 1e-9)

    @property
    def last_tick(self) -> int:
        """Tick at which the run ends: the duration in whole ticks."""
        return ceil(self.duration / self.tick - 1e-9)

    def misfits(self, where: str, dim: int) -> Iterator[str]:
        ticks = (self.warm_up + self.duration) / self.tick
        if ticks > MOST_TICKS:
            yield f"tick: {self.tick:g} s makes {ticks:.3g} ticks, at most {MOST_TICKS:g} are counted; raise it"
        yield from super().misfits(where, dim)

    def problems(self, where: str, context: Context) -> Iterator[str]:
        first: dict[str, int] = {}
        names: list[tuple[str, int]] = []
        discs: list[tuple[np.ndarray, float]] = []
        sound = self.arena is None or self.arena.fault(self.domain.extent) is None
        for n, group in enumerate(self.robots):
            if group.name in first:
                yield (
                    f"robots[{n}].name: '{group.name}' is the name of robots[{first[group.name]}] too; "
                    "give each group its own"
                )
            first.setdefault(group.name, n)
            places = group.places(self.floor) if sound else None
            if places is not None:
                names += [(f"robots[{n}]", k) for k in range(group.count)]
                discs.append((places, group.body.radius))
            if discs and (self.rivals or n == len(self.robots) - 1):
                yield from too_close(names, discs)
                names, discs = [], []
        yield from self._messages()

    def _messages(self) -> Iterator[str]:
        """Groups that tell each other too much together, though none does alone."""
        talking = [(f"robots[{n}]", group) for n, group in enumerate(self.robots) if group.algorithm.talks]
        alone = any(line for where, group in talking for line in too_many_messages(where, [group]))
        if len(talking) > 1 and not alone:
            yield from too_many_messages(talking[-1][0], [group for _, group in talking])
