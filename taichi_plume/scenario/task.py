"""A scenario as a reinforcement learning task: episodes, realisations of the flow (airs) and rewards."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from taichi_plume.quantities import number
from taichi_plume.scenario import si
from taichi_plume.scenario.playback import Played
from taichi_plume.scenario.vocabulary import FileName, Model

if TYPE_CHECKING:
    from taichi_plume.scenario.domain import Context

Worth = Annotated[float, *number(-1e6, 1e6)]


class Reward(Model):
    """Reward of a robot's step: the sum of these terms."""

    found: Worth = 1.0
    """Reward for finding a source: by reaching or declaring it, as the group's `found` says."""
    time: Worth = -0.01
    """Reward per second of time."""
    path: Worth = 0.0
    """Reward per metre driven."""
    bump: Worth = -0.02
    """Reward per collision of the robot."""
    gas: Worth = 0.0
    """Reward per second, times the gas entry of the observation."""
    progress: Worth = 0.0
    """Reward per metre by which the robot came nearer to the nearest source. It uses the true position, which is in no
    observation."""
    false_declaration: Worth = -0.5
    """Reward for declaring a source where none is."""


class Task(Model):
    """Task of environments for reinforcement learning."""

    episode: si.Duration = 60.0
    """Longest time of an episode."""
    airs: Annotated[int, Field(ge=1, le=1000)] = 1
    """Number of flow realisations (airs) to record before learning. The first has the seed of the air, the others the
    next seeds."""
    film: si.Duration | None = None
    """Length of each recording; unless given, twice an episode. Episodes start at any time that leaves enough of it."""
    spacing: si.Length | None = None
    """Edge of the cells of recordings, rounded to whole cells of the domain, whose means they hold; by default one."""
    heights: tuple[si.Distance, si.Distance] | None = None
    """Lowest and highest point of the recordings for drones; by default floor and ceiling. Beyond, the ends hold."""
    frame: si.Wait = 0.5
    """Time between the frames of recordings, rounded to whole ticks; in between, the air is linear in time."""
    films: tuple[FileName, ...] = ()
    """Films to play instead, each in place of the file of a wind or gas of kind playback."""
    sources: Literal["all", "one"] = "all"
    """Whether all gases of the scenario are present, or in each episode a single one, drawn at random."""
    mirror: bool = True
    """Whether a random half of the episodes is mirrored: left is right, for observations and actions."""
    units: bool = True
    """Whether each episode draws another unit of the model of a gas sensor; otherwise each environment keeps one."""
    reward: Reward = Reward()
    """Reward of a step."""

    @property
    def length(self) -> float:
        """Length of each recording of wind and gas [s]; by default two episodes."""
        return 2.0 * self.episode if self.film is None else self.film

    def warnings(self, where: str, context: "Context") -> Iterator[str]:
        robots = context.scenario.robots
        group = next((group for group in robots if group.algorithm.kind == "policy"), None)
        if group is not None and group.wake:
            what = "downwash" if group.body.flies else "wake"
            yield f"{where}: films are recorded without robots, so environments leave out the {what} of '{group.name}'"

    def errors(self, where: str, context: "Context") -> Iterator[str]:
        if self.film is not None and self.film < self.episode:
            yield f"{where}.film: {self.film:g} s is shorter than an episode of {self.episode:g} s; raise it"
        scenario, domain = context.scenario, context.domain
        flies = bool(scenario.robots) and scenario.learners.body.flies
        if self.heights is not None:
            low, high = self.heights
            if not flies:
                yield f"{where}.heights: is for drones; give the learners body.kind: drone, or remove it"
            elif not low < high <= domain.extent[2] + 1e-9:
                yield f"{where}.heights: {low:g} to {high:g} m; must rise, up to the ceiling at {domain.extent[2]:g} m"
        if self.spacing is not None and not domain.spacing <= self.spacing * (1 + 1e-9) <= min(domain.extent):
            least, most = domain.spacing, min(domain.extent)
            yield f"{where}.spacing: {self.spacing:g} m; must be from domain.spacing = {least:g} m to {most:g} m"
        played = [scenario.wind, *(gas for _, gas in scenario.gases)]
        if self.films and not any(isinstance(part, Played) and part.kind == "playback" for part in played):
            yield f"{where}.films: neither wind nor gas is of kind playback; use that kind for one of them"
