"""Search algorithms of teams, whose robots share messages, a line, lanes or a map."""

from collections.abc import Iterator, Sequence
from math import ceil, sqrt
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, get_args

import numpy as np
from pydantic import Field

from taichi_plume.quantities import round_up
from taichi_plume.scenario import si
from taichi_plume.scenario.maps import MOST_CELLS, TEAM_MAPS, TeamMap, TimeSeriesMap
from taichi_plume.scenario.search_algorithm import AnyAlgorithm, Listening
from taichi_plume.scenario.starts import GAP
from taichi_plume.scenario.vocabulary import SHAPE, Model, consistency_check

if TYPE_CHECKING:
    from taichi_plume.scenario.domain import Arena
    from taichi_plume.scenario.robots import Group

MOST_PAIRS = 20_000_000  # of robots that keep each other's messages: half a gigabyte
MOST_LANES = 10_000


class Neighbourhood(Model):
    """Base class of the neighbourhoods, each with one number."""

    @property
    def limit(self) -> float:
        """The one number of a neighbourhood: largest distance [m], number or probability of neighbours."""
        (limit,) = (value for key, value in vars(self).items() if key != "kind")
        return float(limit)


class SearchSpace(Neighbourhood):
    """Robots that were near when they sent their message."""

    kind: Literal["search_space"]
    distance: si.Length = 1.5
    """Largest distance of a neighbour when it sent its message."""


class FunctionValue(Neighbourhood):
    """Neighbourhood by reading: neighbours are the robots whose best readings are closest to the robot's own."""

    kind: Literal["function_value"]
    number: si.Count = 2
    """Number of neighbours of each robot."""


class RandomMates(Neighbourhood):
    """Robots that are drawn at random at each way point."""

    kind: Literal["random"]
    probability: si.Fraction = 0.5
    """Probability that another robot becomes a neighbour."""


class Repelled(AnyAlgorithm):
    """Base class of algorithms whose robots walls and other robots push away."""

    avoidance: si.Length = 0.1
    """Distance to walls and other robots below which they push the robot away."""

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        gap = group.body.radius + self.avoidance
        if 2 * gap >= min(floor.size):
            yield f"{where}.algorithm.avoidance: no place is {gap:g} m (radius + avoidance) from all walls; lower it"


class Dapso(Listening, Repelled):
    """Particle swarm optimisation by robots without a common clock (Akat & Gazi 2008). See agents/dapso.py."""

    talks: ClassVar[bool] = True
    kind: Literal["dapso"]
    acquisition: si.Wait = 2.0
    threshold_ppm: si.Ppm = 1.0
    """Smallest best reading that the swarm follows: below, robots explore at random places. 0: they never explore."""
    phi1: si.Coefficient = 2.05
    """Strength of the pull to the best place of the robot itself."""
    phi2: si.Coefficient = 2.05
    """Strength of the pull to the best place of its neighbours."""
    kappa: si.SomeFraction = 1.0
    """Convergence of the steps: kappa of the constriction chi. Less lets steps shorten sooner."""
    longest_step: si.Length = 0.5
    """Longest distance from way point to way point."""
    memory: si.Delay = 60.0
    """Time constant with which a best reading fades, as gas comes and goes; 0: it does not."""
    neighbourhood: Annotated[SearchSpace | FunctionValue | RandomMates, Field(discriminator="kind")] = (
        SearchSpace(kind="search_space")
    )
    """Which team mates in range (see `communication`) are neighbours, whose best places count."""
    way_point_tolerance: si.Length = 0.05
    """Distance from a way point at which the robot has reached it."""
    way_point_timeout: si.Duration = 15.0
    """Time after which it gives up a way point and measures where it is."""
    restart_after: Annotated[int, Field(ge=0, le=1_000_000)] = 3
    """After so many short steps in a row it forgets all and drives to a random place; 0: never."""
    restart_step: si.Length = 0.05
    """Length below which a step counts as short."""
    avoidance: si.Length = 0.2

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        yield from super().in_group(where, group, floor)
        yield from too_many_messages(where, [group])

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        return 24.0 * group.trials * group.count**2


class LineUp(Repelled):
    """Line-up: a diagonal line of robots that sweeps across the wind (Marjovi & Marques 2014). See agents/lineup.py."""

    kind: Literal["lineup"]
    speed: si.Speed | None = None
    """Speed of a robot that takes its place; unless given, the body's largest."""
    line_speed: si.TopSpeed = 0.1
    """Speed of the line across the wind. Below that of the robots, so that they can keep up."""
    wind_direction_deg: si.Angle | None = None
    """Direction in which the air goes, from the x axis to the left; unless given, the team measures it at the start."""
    listen: si.Wait = 5.0
    """Time for which the team measures the wind at the start."""
    spacing: si.Length | None = None
    """Distance between neighbours along the wind; unless given, the line reaches from margin to margin."""
    stagger: si.Distance = 0.3
    """Distance between neighbours across the wind; of a lone robot, its step along the wind after each sweep."""
    mirror: bool = False
    """Whether the line forms again before it goes back, so that the same end leads."""
    margin: si.Length = 0.3
    """Distance from the walls to the line."""
    tolerance: si.Length = 0.15
    """The line waits for robots that are farther than this from their places."""
    patience: si.Delay = 10.0
    """Time without progress after which the line no longer waits for a robot."""

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        yield from super().in_group(where, group, floor)
        if 2 * self.margin >= min(floor.size):
            yield f"{where}.algorithm.margin: {self.margin:g} m to all walls leaves no floor; lower it"
            return
        if group.count == 1:
            return
        # The line is at most as long as the diagonal; along an axis, as that side
        longest = sum((length - 2 * self.margin) ** 2 for length in floor.size) ** 0.5
        if self.wind_direction_deg is not None and self.wind_direction_deg % 90 == 0:
            longest = floor.size[int(self.wind_direction_deg % 180 == 90)] - 2 * self.margin
        even = longest / (group.count - 1)
        if self.spacing is not None and self.spacing * (group.count - 1) > longest + 1e-9:
            yield (
                f"{where}.algorithm.spacing: a line of {group.count} robots {self.spacing:g} m apart does not fit "
                f"between the margins, {longest:.3g} m; use at most {even:.3g} m, or fewer robots"
            )
        elif (self.spacing or even) < 2 * group.body.radius + GAP:
            key = "count" if self.spacing is None else "algorithm.spacing"
            yield (
                f"{where}.{key}: {group.count} robots {2 * group.body.radius:g} m wide would touch in a line with "
                f"{self.spacing or even:.3g} m from robot to robot; use fewer or smaller robots"
            )


class Sweep(Repelled):
    """Parallel lanes to and fro, shared out between the robots of a team. See agents/sweep.py."""

    kind: Literal["sweep"]
    speed: si.Speed | None = None
    """Speed at which they drive; unless given, the body's largest."""
    lane: Annotated[si.Length, SHAPE] = 0.3
    """Largest width of a lane: narrower ones cover the floor more closely, and take longer."""
    along: Literal["x", "y"] | None = None
    """Axis along which the lanes run; unless given, the longer side of the floor."""
    repeat: bool = True
    """Go back along the same lanes at the end, again and again; otherwise the robots stay there."""
    avoidance: si.Length = 0.05

    def lanes(self, size: Sequence[float] | np.ndarray, robots: int) -> tuple[int, int]:
        """Return the axis (0: x, 1: y) and number of lanes on a floor of this size [m], at least one per robot."""
        axis = int(size[1] > size[0]) if self.along is None else "xy".index(self.along)
        return axis, max(ceil(size[1 - axis] / self.lane - 1e-9), robots)

    def grid_error(self, where: str, floor: "Arena") -> str | None:
        _, number = self.lanes(floor.size, 1)
        if number > MOST_LANES:
            least = round_up(max(floor.size) / MOST_LANES)
            return f"{where}.algorithm.lane: {self.lane:g} m makes {number} lanes; use {least:g} m or more"
        return None

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        return 16.0 * group.trials * (self.lanes(floor.size, group.count)[1] + group.count)

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        yield from super().in_group(where, group, floor)
        axis, number = self.lanes(floor.size, group.count)
        width = floor.size[1 - axis]
        if self.lane > width:
            yield f"{where}.algorithm.lane: {self.lane:g} m is wider than the floor, {width:g} m; use narrower lanes"
        least = 2 * group.body.radius + GAP
        if group.count > 1 and width / number < least:
            key = "count" if number == group.count else "algorithm.lane"
            yield (
                f"{where}.{key}: {number} lanes across {width:g} m are {width / number:.3g} m wide, and the robots in "
                f"them {2 * group.body.radius:g} m; use {'fewer robots' if key == 'count' else 'wider lanes'}"
            )


class LeastKnown(Repelled):
    """Drive to where a measurement improves the team's gas map most. See agents/least_known.py."""

    kind: Literal["least_known"]
    speed: si.Speed | None = None
    """Speed at which they drive; unless given, the body's largest."""
    map: TeamMap = TimeSeriesMap(kind="time_series")
    """Map of the team's readings that decides where to measure next; a forgotten place is unknown again."""
    criterion: Annotated[Literal["weight", "variance", "upper_bound", "information"], SHAPE] = "weight"
    """Gain of a measurement. `weight`: least weight in the map; `variance`: of the map; `upper_bound`: mean + kappa
    deviations; `information`: expected reduction of the variance summed over the map."""
    kappa: si.Coefficient = 2.0
    """Standard deviations above the mean in `upper_bound`: more explores, less goes to the gas."""
    way_scale: si.Length = 1.0
    """The gain counts over the length of the way plus this length: more drives farther for the largest gain."""
    share: si.SomeFraction = 0.1
    """With `weight`, share of all cells that count as the least known; the robot goes to the nearest of them."""
    apart: si.Length = 0.5
    """Least distance of a way point from the robot and from those of its team mates."""

    @consistency_check
    def _map_of_the_team(self) -> Iterator[str]:
        if self.map.robot is not None:
            yield "map.robot: the map is that of the team; remove it"
        if getattr(self.map, "layer", None) is not None:
            yield "map.layer: robots choose places on the floor; remove it"
        if self.criterion not in ("weight", *self.map.gains):
            able = [
                kind.model_fields["kind"].annotation for kind in TEAM_MAPS if self.criterion in kind.gains
            ]
            kinds = " or ".join(kind for each in able for kind in get_args(each))
            yield f"criterion: {self.criterion} needs a map of kind {kinds}, not {self.map.kind}"

    def grid_error(self, where: str, floor: "Arena") -> str | None:
        return self.map.grid_error(f"{where}.algorithm.map", floor.high)

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        return group.trials * self.map.bytes(floor.high, group.count / tick)

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        yield from super().in_group(where, group, floor)
        room = group.body.radius + self.avoidance
        least = 2.0 * sqrt(floor.size[0] * floor.size[1] / MOST_CELLS)
        if room < least:
            yield (
                f"{where}.algorithm.avoidance: radius + avoidance = {room:g} m is too little for so large a floor; "
                f"raise it to {round_up(least - group.body.radius):g} m or more"
            )


def too_many_messages(where: str, groups: "Sequence[Group]") -> Iterator[str]:
    """Yield an error if these groups' robots would store too many messages, one per robot and possible sender."""
    last = groups[-1]
    pairs = sum(group.count * group.trials for group in groups) * max(group.count for group in groups)
    if pairs > MOST_PAIRS:
        others = ", with those of the groups before," if len(groups) > 1 else ""
        yield (
            f"{where}.count: {last.count} robots in {last.trials} trials{others} would keep {pairs:.2g} messages; "
            f"use fewer robots or trials, for at most {MOST_PAIRS:.2g}"
        )
