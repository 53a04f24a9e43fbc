"""Search algorithms with a belief (posterior probability) of the source: infotaxis, particle filter, hit map, and the
estimate of source terms.
"""

from collections.abc import Iterator
from math import ceil, sqrt
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from taichi_plume.quantities import ill_sized, number
from taichi_plume.scenario import si
from taichi_plume.scenario.plume_tracking import Casting
from taichi_plume.scenario.prior import Prior
from taichi_plume.scenario.search_algorithm import AnyAlgorithm, Listening
from taichi_plume.scenario.vocabulary import AT_START, Model, consistency_check

if TYPE_CHECKING:
    from taichi_plume.scenario.domain import Arena
    from taichi_plume.scenario.robots import Group

MOST_CELLS = 250_000  # of a belief map: a step of a robot looks at all of them five times


class Declares(AnyAlgorithm):
    """Algorithms with a belief, the posterior of the source's position. See agents/beliefs.py."""

    believes: ClassVar[bool] = True
    most_cells: ClassVar[int] = MOST_CELLS
    declare_spread: si.Length | None = 0.2
    """Spread of the belief below which a robot declares the source at the belief's mean. It is the root mean square
    distance from this mean: if the belief is normal and right, 0.2 m puts 95 % of the declared positions within the
    usual reach, 0.35 m, of the source. null: the robot never declares; also the default if a single cell is wider."""
    prior: Annotated[Prior | None, AT_START] = None
    """Belief before the first reading, and after evidence that rules out all places. Unless given it is uniform."""

    @property
    def may_declare(self) -> bool:
        return self.declare_spread is not None

    @property
    def least_spread(self) -> float:
        """Smallest possible spread [m] of the belief about the source: that of a belief in a single cell."""
        return vars(self)["cell"] / sqrt(6.0)

    @model_validator(mode="after")
    def _never_declares(self) -> Self:
        """Set the default `declare_spread` to null if a belief on cells of this size can never be that narrow."""
        if "declare_spread" not in self.model_fields_set and not self._reaches(self.declare_spread):
            object.__setattr__(self, "declare_spread", None)  # not among the keys that the user set
        return self

    def grid_error(self, where: str, floor: "Arena") -> str | None:
        return ill_sized(f"{where}.algorithm.cell", vars(self)["cell"], floor.size, self.most_cells)

    def _reaches(self, spread: float | None) -> bool:
        return spread is None or spread > self.least_spread

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        spread = self.declare_spread
        if group.found == "declared" and "declare_spread" not in self.model_fields_set:
            spread = type(self).model_fields["declare_spread"].default
        if not self._reaches(spread):
            yield (
                f"{where}.algorithm.declare_spread: {spread:g} m is never reached, as a single cell has a spread of "
                f"{self.least_spread:.3g} m; raise it, or lower cell"
            )
        yield from super().in_group(where, group, floor)


class TeamInference(Listening, Declares):
    """Algorithms whose robots stand still to measure, and update a belief by each acquisition."""

    share: Literal["none", "readings"] = "none"
    """Whether the robots of a team share their readings. Each acquisition is sent within the range, rate and loss of
    `communication`, and updates the belief of each robot that receives it as its own; none: each is on its own."""


class AnyInfotaxis(TeamInference):
    """Infotaxis of all kinds. See agents/infotaxis.py."""

    searches: ClassVar[bool] = True
    kind: str
    acquisition: si.Wait = 2.0
    threshold_ppm: si.SomePpm = 5.0
    """Mean reading of an acquisition that counts as a detection."""
    step: si.Length = 0.25
    """Distance driven after each acquisition, unless the robot stays."""
    cell: si.Length = 0.1
    """Edge of the cells of the belief map. Smaller ones take longer."""
    rate: si.Frequency = 1.0
    """Detections per second close to the source, in the model of the robot."""
    diffusivity: Annotated[si.EddyDiffusivity, Field(ge=1e-9)] = 0.05
    """Diffusivity of patches of gas, in the model of the robot. More makes its plume wider."""
    wind_speed: si.Speed = 0.5
    """Mean speed of the wind, in the model of the robot."""
    lifetime: si.Duration = 10.0
    """Lifetime of patches of gas, in the model of the robot."""
    size: si.Length = 0.05
    """Size of the detector of patches, in the model of the robot; small beside the plume."""

    @property
    def reach(self) -> float:
        """Length lambda [m] over which detections of gas patches fade: sqrt(D tau / (1 + V² tau / (4 D)))."""
        D, V, tau = self.diffusivity, self.wind_speed, self.lifetime
        return sqrt(D * tau / (1.0 + V**2 * tau / (4.0 * D)))

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        """Return the memory [bytes] of every robot's belief, and of a table of detection probabilities by distance."""
        cells = floor.size[0] * floor.size[1] / self.cell**2
        chances = 16.0 * (floor.size[0] ** 2 + floor.size[1] ** 2) / self.cell**2
        return 4.0 * (group.count * group.trials * cells + chances)

    @consistency_check
    def _small_detector(self) -> Iterator[str]:
        if self.size >= self.reach:
            yield f"size = {self.size:g} m must be below lambda = {self.reach:.3g} m; or raise diffusivity"


class Infotaxis(AnyInfotaxis):
    """Steps with the largest expected information on the source (Vergassola et al. 2007). See agents/infotaxis.py."""

    kind: Literal["infotaxis"]  # type: ignore[assignment]


class SpaceAwareInfotaxis(AnyInfotaxis):
    """Infotaxis that also prefers to be near the source (Loisy & Eloy 2022). See agents/infotaxis.py."""

    kind: Literal["space_aware_infotaxis"]  # type: ignore[assignment]


class ParticleFilter(Casting, Declares):
    """Casts along the plume while a particle filter follows the gas back along the measured wind (after Li et al.
    2011). See agents/particle_filter.py.
    """

    kind: Literal["particle_filter"]  # type: ignore[assignment]
    particles: Annotated[int, Field(ge=10, le=100_000)] = 500
    """Number of particles of each robot. More make a smoother posterior, and take longer."""
    period: si.Wait = 1.0
    """Time between two updates of the particles; the wind of each is averaged over it."""
    memory: si.Wait = 60.0
    """Time for which the measured wind is kept and gas is followed back: as long as gas takes from the source."""
    patch: si.Length = 0.1
    """Radius of a patch of gas when it is released: standard deviation of its distribution."""
    notice: si.Length = 0.3
    """Distance from the middle of a patch at which a robot still notices it. More makes the model's plume denser."""
    diffusivity: Annotated[si.EddyDiffusivity, Field(ge=1e-9)] = 0.01
    """Growth of the uncertainty of a patch's position: variance per axis over twice the time. About the variance of the
    wind's speed times the time for which a gust lasts."""
    detection: si.SomeFraction = 0.3
    """Chance of a detection at an update in the midst of patches. Whiffs come in bouts: a low one keeps misses in a
    row, which are not independent, from ruling out the truth."""
    false_alarm: si.Fraction = 0.01
    """Chance that an update counts as a detection without gas of the source. With it, one misleading whiff does not
    rule out the truth."""
    roughening: si.Fraction = 0.2
    """Scatter of resampled particles, over their extent and times the square root of their number."""
    estimates: Annotated[int, Field(ge=2, le=1000)] = 20
    """The filter has converged when so many estimates in a row, one at each update, lie together."""
    converged: si.Length = 0.3
    """Largest scatter (root mean square) of these estimates, and of the particles, for the robot to go there."""
    avoidance: si.Length = 0.1
    """Distance kept to walls and other robots on the way to the estimate."""
    cell: si.Length = 0.1
    """Edge of the cells of the belief map that is written; the particles themselves have no cells."""
    least_spread: ClassVar[float] = 0.0

    @property
    def releases(self) -> int:
        """Number of past periods for which each robot stores the measured wind: memory / period, at least 1."""
        return max(1, ceil(self.memory / self.period - 1e-9))

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        """Return the memory [bytes] of all robots: particles (twice while resampled), wind, estimates, belief."""
        each = 20.0 * self.particles + 20.0 * (self.releases + 1) + 8.0 * self.estimates
        belief = 2 * 4.0 * floor.size[0] * floor.size[1] / self.cell**2
        return group.count * group.trials * (each + belief)

    @consistency_check
    def _few_periods(self) -> Iterator[str]:
        if self.releases > 10_000:  # every particle looks at all of them
            yield f"memory = {self.memory:g} s is more than 10000 periods of {self.period:g} s; lower it"


class HitMap(TeamInference):
    """Measures where it expects to learn most, on a map of the floor with obstacles (after Ojeda et al. 2021).

    See agents/hit_map.py.
    """

    searches: ClassVar[bool] = True
    most_cells: ClassVar[int] = 2_500  # the map keeps the path from each cell to each
    kind: Literal["hit_map"]
    acquisition: si.Wait = 3.0
    lag: Literal["ignored", "deconvolved"] = "deconvolved"
    """Whether a hit is judged by the mean reading, or by the mean gas that the lagging sensor met."""
    threshold_ppm: si.SomePpm = 5.0
    """Mean reading of an acquisition that counts as a hit."""
    cell: si.Length = 0.2
    """Edge of the map's cells. Smaller ones locate more finely, and take longer."""
    calm: si.Speed = 0.05
    """Mean wind speed below which its direction is ignored, and only the distance counts."""
    spread_deg: Annotated[float, *number(1, 180, "deg")] = 35.0
    """Standard deviation of the angle between upwind and the way to the source, where there is gas. Plumes are as wide
    as the wind's direction scatters, 10 to 20°; as much again is for air that obstacles turn aside on the way."""
    fading: si.Length = 5.0
    """Way along the wind over which the chance of a hit falls by a factor of e."""
    near: si.Length = 0.3
    """Standard deviation of the way to the source, where there is gas in calm air."""
    hit: si.SomeFraction = 0.8
    """Chance of a hit straight downwind of the source, and near it."""
    false_alarm: Annotated[float, Field(ge=1e-4, lt=0.5)] = 0.05
    """Chance of a hit anywhere else."""
    range: si.Length = 2.0
    """Longest distance to the next place to measure at."""
    converged: si.Length = 0.3
    """Spread of the belief, see declare_spread, at which the next place to measure at is the expected one of the
    source."""
    avoidance: si.Distance = 0.1
    """Distance kept to walls and other robots."""

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        """Return the memory [bytes] of every robot's belief, and of gas and robot paths between all pairs of cells."""
        cells = floor.size[0] * floor.size[1] / self.cell**2
        return 4.0 * group.count * group.trials * cells + 2 * 6.0 * cells**2

    @consistency_check
    def _hit_above_false_alarm(self) -> Iterator[str]:
        if self.hit <= self.false_alarm:
            yield f"hit = {self.hit:g} must be above false_alarm = {self.false_alarm:g}"


SomeRate = Annotated[si.Rate, Field(ge=1e-15)]
SomeDiffusivity = Annotated[si.EddyDiffusivity, Field(ge=1e-6)]


class RatePrior(Model):
    """Prior of the strength of a source: log-uniform between `low` and `high`, or log-normal about a `median`."""

    low: SomeRate | None = None
    """Smallest possible rate of a source; 0.1 mg/s unless given."""
    high: SomeRate | None = None
    """Largest possible rate of a source; 1 g/s unless given."""
    median: SomeRate | None = None
    """Most likely rate of a source, instead of `low` and `high`."""
    factor: Annotated[float, Field(ge=1.01, le=1e6)] | None = None
    """Factor by which the rate is off its `median`, as a standard deviation; 3 unless given."""

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest rate of the log-uniform prior [kg/s]."""
        return 1e-7 if self.low is None else self.low, 1e-3 if self.high is None else self.high

    @consistency_check
    def _single_form(self) -> Iterator[str]:
        low, high = self.limits
        if self.median is not None and not (self.low is None and self.high is None):
            yield f"{'high' if self.low is None else 'low'}: is not for a median; remove it, or median"
        elif self.median is None and self.factor is not None:
            yield "factor: needs a median; give it, or remove factor"
        elif low >= high:
            yield f"low = {low:g} kg/s must be below high = {high:g} kg/s"


class SourceTerm(TeamInference):
    """Infers place, strength and number of sources by a model of dispersion, and measures where it learns most.

    See agents/source_term.py.
    """

    searches: ClassVar[bool] = True
    estimates_rates: ClassVar[bool] = True
    most_cells: ClassVar[int] = 20_000
    most_road_cells: ClassVar[int] = 2_500  # the paths from each cell to each are kept
    kind: Literal["source_term"]
    share: Literal["none", "readings"] = "readings"
    acquisition: si.Wait = 5.0
    lag: Literal["ignored", "deconvolved"] = "deconvolved"
    """Whether a reading counts as the sensor gives it, or as the gas that the lagging sensor met."""
    likelihood: Literal["readings", "hits", "counts"] = "readings"
    """Data of an acquisition: its mean reading, whether that is above the threshold, or the number of samples above."""
    threshold_ppm: si.SomePpm = 1.0
    """Reading above which there is gas for `hits` and `counts`. For `readings` a floor, below which differences do not
    count."""
    sources: Annotated[int, Field(ge=1, le=3)] = 1
    """Largest number of sources. With more than one their number is inferred, too."""
    rate: RatePrior = RatePrior()
    """Prior of the strength of a source: limits `low` and `high`, or a `median` and its `factor`."""
    source_height: si.Distance | None = None
    """Height of the sources over the floor; 3-D only. Unless given, that of the gas sensor."""
    cell: si.Length = 0.1
    """Edge of the cells of the belief and of the model of dispersion. Smaller ones take longer. In 3-D the cells fill
    the room: with more than 40,000 of them a stop takes seconds."""
    particles: Annotated[int, Field(ge=50, le=20_000)] = 500
    """Number of samples of the posterior of each robot. More make it smoother, and take longer."""
    diffusivity: tuple[SomeDiffusivity, SomeDiffusivity] = (0.002, 0.06)
    """Limits of the eddy diffusivity of the mean plume, in the model of the robot. More makes its plume wider."""
    lifetime: si.Duration = 300.0
    """Time for which gas stays in the room, in the model of the robot. In rooms without an outlet, about the time since
    the release."""
    correlation: si.Length = 0.25
    """Distance over which errors of the model are alike: measurements closer together count less."""
    range: si.Length = 2.0
    """Longest distance to the next place to measure at."""
    converged: si.Length = 0.3
    """Spread of the belief, see declare_spread, at which the next place to measure at is the expected one of the
    source."""
    avoidance: si.Distance = 0.1
    """Distance kept to walls and other robots."""
    least_spread: ClassVar[float] = 0.0
    declare_spread: si.Length | None = 0.25
    """Spread of the belief in the surest source below which a robot declares it. null: the robot never declares."""

    @consistency_check
    def _orders_diffusivity(self) -> Iterator[str]:
        low, high = self.diffusivity
        if low > high:
            yield f"diffusivity: its lower limit {low:g} is above the upper one {high:g} m^2/s; exchange them"

    @property
    def road_cell(self) -> float:
        """Edge of the cells between which the robot plans its way [m]."""
        return max(2.0 * self.cell, 0.2)

    def grid_error(self, where: str, floor: "Arena") -> str | None:
        error = super().grid_error(where, floor)
        roads = floor.size[0] * floor.size[1] / self.road_cell**2
        if error is None and roads > self.most_road_cells:
            error = (
                f"{where}.algorithm.cell: {self.cell:g} m makes {roads:.0f} cells of {self.road_cell:g} m for the "
                f"ways, at most {self.most_road_cells} are allowed; raise it"
            )
        return error

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        """Return the memory [bytes] of the particles, of responses to measurements, and of the paths between cells."""
        cells = floor.size[0] * floor.size[1] / self.cell**2
        measurements = 100
        each = 8.0 * self.particles * (3 * self.sources + 3 + measurements) + 8.0 * cells * measurements
        return (
            group.count * group.trials * each + 6.0 * (floor.size[0] * floor.size[1] / self.road_cell**2) ** 2
        )
