"""Base class of the search algorithms, and those that stand still to sample the gas (acquisitions)."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from taichi_plume.quantities import number
from taichi_plume.scenario import si
from taichi_plume.scenario.vocabulary import Model

if TYPE_CHECKING:
    from taichi_plume.scenario.domain import Arena
    from taichi_plume.scenario.robots import Group


class AnyAlgorithm(Model):
    """Base class of the algorithms: their properties and checks."""

    talks: ClassVar[bool] = False
    """Whether robots keep the messages of each other."""
    searches: ClassVar[bool] = False
    """Whether robots do nothing but look for a source."""
    believes: ClassVar[bool] = False
    """Whether robots keep a posterior of the source's position."""
    estimates_rates: ClassVar[bool] = False
    """Whether robots estimate the strengths of the sources."""
    in_space: ClassVar[bool] = False
    """Whether robots have to fly."""
    outside: ClassVar[bool] = False
    """Whether another program drives the robots."""
    placed: ClassVar[bool] = False
    """Whether poses of the robots come from outside."""
    may_declare: ClassVar[bool] = False
    """Whether robots may declare a source."""

    @property
    def own_speed(self) -> float | None:
        """Value of the key `speed` [m/s]; None: not given, or no such key."""
        return vars(self).get("speed")

    @property
    def threshold(self) -> float | None:
        """Reading [ppm] at which the behaviour changes; None if there is none."""
        return vars(self).get("threshold_ppm")

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        """Yield errors of the algorithm for these robots on this floor; where: path of the group, such as robots[0]."""
        yield from ()

    def grid_error(self, where: str, floor: "Arena") -> str | None:
        """Return an error if a grid of the algorithm has too many or too few cells; where: path of the group."""
        return None

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        """Return about the memory [bytes] that the algorithm needs for all trials; tick: control period [s]."""
        return 0.0


class Listening(AnyAlgorithm):
    """Base class of algorithms that stand still to measure: an acquisition is a series of samples."""

    speed: si.Speed | None = None
    """Speed at which they drive; unless given, the body's largest."""
    acquisition: si.Wait = 30.0
    """Time for which a robot stands still and samples. Longer averages over more whiffs, and slows the search."""
    sample_period: si.Wait = 0.5
    """Time between the samples of an acquisition."""
    settle: si.Pause = 1.0
    """Time of standing still before the samples, for a slow sensor to catch up."""
    lag: Literal["ignored", "deconvolved"] = "ignored"
    """Whether the mean of an acquisition is that of the readings, or of the gas that the lagging sensor met. The second
    adds the change of the readings, times the sensor's time constant over the time of the samples."""

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        if getattr(group.sensors.nose, "gives", "") == "rank" and (
            self.estimates_rates or self.lag != "ignored"
        ):
            need = "algorithm.lag: deconvolved" if self.lag != "ignored" else "the algorithm"
            yield f"{where}.sensors.gas.gives: a rank is no concentration, which {need} needs; use ppm or ratio"
        yield from super().in_group(where, group, floor)


class Spiral(Listening):
    """Spirals of straight arms around places of ever more gas, for rooms without strong wind.

    Ferri et al. 2009. See agents/spiral.py.
    """

    searches: ClassVar[bool] = True
    kind: Literal["spiral"]
    acquisition: si.Wait = 30.0
    sample_period: si.Wait = 0.5
    minimum_ppm: si.SomePpm = 0.2
    """Threshold of the proximity index at the start, and after an escape: a mean index far from the source."""
    delta: Annotated[float, Field(ge=1e-6, lt=1)] = 0.2
    """Decrease of the threshold below the minimum by misses, over the minimum."""
    mean_weight: si.Coefficient = 1.0
    """Weight of the mean of an acquisition in its proximity index."""
    peak_weight: si.Coefficient = 0.5
    """Weight of the sum of its peaks in the proximity index. Peaks are higher near the source."""
    peak_window: si.Wait = 5.0
    """Only the largest peak within so long a time counts."""
    peak_height: Literal["above_mean", "absolute"] = "above_mean"
    """Height of a peak that counts: above the mean, or the whole concentration. The paper states neither, but that the
    mean covers low peaks: a whole peak is never lower than the mean."""
    sense: Literal["left", "right", "random"] = "left"
    """Side to which the robot turns between the arms; random: drawn for each search. The paper shows one path (figure
    5), that of fixed figures (section 3.2), and names what it draws by chance: the angle of an escape. It does not say
    which side; left is ours, and the mirror image of right from a mirrored start."""
    first_move: Literal["arm", "turn", "acquisition"] = "arm"
    """Start of the first spiral of a search. It begins with its arm straight ahead, with the turn and then the arm, or
    with an acquisition where the robot stands. By the paper an acquisition ends an arm (section 3.2), and robots start
    across the direction to the source (section 5): a turn at once would face the source or its opposite."""
    arms: Annotated[tuple[si.Length, ...], Field(min_length=1, max_length=100)] = (
        0.4,
        0.4,
        0.8,
        0.8,
        1.2,
        1.2,
    )
    """Lengths of a spiral's arms, in their order. The paper only says that they suit the area (section 3). With these
    random SPIRAL takes the published acquisitions in an arena of 3 x 2.1 m, as with three other sets."""
    escape_length: si.Length = 0.75
    """Distance to the start of a new spiral after all arms failed."""
    bump_side: Literal["spiral", "gradient"] = "spiral"
    """Where it turns at a bump: as the spiral does, or to the side of the best of the last 10 acquisitions."""
    strict_minimum: bool = False
    """Whether an index below the minimum is never a hit, even with a lowered threshold."""
    random: bool = False
    """Random SPIRAL, as a reference: the index is drawn between 0 and 1, whatever the sensor reads."""

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        return 4.0 * group.count * group.trials * self.acquisition / max(self.sample_period, tick)


class EColi(Listening):
    """Run and tumble, as bacteria do (Russell et al. 2003). See agents/ecoli.py."""

    searches: ClassVar[bool] = True
    kind: Literal["ecoli"]
    acquisition: si.Wait = 3.0
    step: si.Length = 0.25
    """Way driven after each acquisition."""
    step_spread: si.Fraction = 0.05
    """Randomness of the way: each step is step (1 ± step_spread), drawn uniformly."""
    run_angle_deg: Annotated[float, *number(0, 180, "deg")] = 5.0
    """Largest turn before a run, that is after a rise; a tumble turns by any angle."""
