"""Lanes, lines and messages of teams that do not fit in the room or in memory."""

from collections.abc import Iterator

from taichi_plume.scenario.algorithms import Dapso, LeastKnown, LineUp, Sweep
from taichi_plume.scenario.checks_robots import START_ROOM
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.scenario import Scenario

MOST_PAIRS = 20_000_000  # of robots that remember each other's messages: half a gigabyte


def problems(scenario: Scenario) -> Iterator[str]:
    """What is wrong with the algorithms of teams."""
    size = scenario.floor.size
    for n, group in enumerate(scenario.robots):
        path, model = f"robots[{n}]", group.algorithm
        if isinstance(model, Dapso | LeastKnown | LineUp | Sweep):
            room = group.body.radius + model.avoidance
            if 2 * room >= min(size):
                yield (
                    f"{path}.algorithm.avoidance: nowhere is {room:g} m to all walls, radius and avoidance together; "
                    "lower it"
                )
                continue
        if isinstance(model, Dapso):
            yield from _messages(path, group)
        elif isinstance(model, Sweep):
            yield from _lanes(path, group, model, size)
        elif isinstance(model, LineUp):
            yield from _line(path, group, model, size)


def _messages(path: str, group: Group) -> Iterator[str]:
    pairs = group.trials * group.count**2
    if pairs > MOST_PAIRS:
        yield (
            f"{path}.count: {group.count} robots in {group.trials} trials would keep {pairs:.2g} messages of each "
            f"other; use fewer robots or trials, for at most {MOST_PAIRS:.2g}"
        )


def _lanes(path: str, group: Group, model: Sweep, size: tuple[float, ...]) -> Iterator[str]:
    axis, number = model.lanes(size, group.count)
    width = size[1 - axis]
    if model.lane > width:
        yield (
            f"{path}.algorithm.lane: {model.lane:g} m is wider than the floor across the lanes, {width:g} m; "
            "use narrower lanes"
        )
    least = 2 * group.body.radius + START_ROOM
    if group.count > 1 and width / number < least:
        key = "count" if number == group.count else "algorithm.lane"
        yield (
            f"{path}.{key}: {number} lanes across {width:g} m are {width / number:.3g} m wide, and the robots in them "
            f"{2 * group.body.radius:g} m; use {'fewer robots' if key == 'count' else 'wider lanes'}"
        )


def _line(path: str, group: Group, model: LineUp, size: tuple[float, ...]) -> Iterator[str]:
    if 2 * model.margin >= min(size):
        yield f"{path}.algorithm.margin: {model.margin:g} m from all walls nothing is left of the floor; lower it"
        return
    if group.count == 1:
        return
    # Whatever the wind, the line is no longer than the diagonal; along an axis, than that side
    longest = sum((length - 2 * model.margin) ** 2 for length in size) ** 0.5
    if model.wind_direction_deg is not None and model.wind_direction_deg % 90 == 0:
        longest = size[int(model.wind_direction_deg % 180 == 90)] - 2 * model.margin
    least = 2 * group.body.radius + START_ROOM
    if model.spacing is not None and model.spacing * (group.count - 1) > longest + 1e-9:
        yield (
            f"{path}.algorithm.spacing: a line of {group.count} robots {model.spacing:g} m apart does not fit between "
            f"the margins, {longest:.3g} m; use at most {longest / (group.count - 1):.3g} m, or fewer robots"
        )
    elif (model.spacing or longest / (group.count - 1)) < least:
        key = "count" if model.spacing is None else "algorithm.spacing"
        yield (
            f"{path}.{key}: {group.count} robots {2 * group.body.radius:g} m wide would touch in a line with "
            f"{model.spacing or longest / (group.count - 1):.3g} m from one to the next; use fewer or smaller robots"
        )
