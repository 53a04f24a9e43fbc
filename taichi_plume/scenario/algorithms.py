"""The search algorithms that robots of a scenario may use, and their parameters."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from taichi_plume.quantities import number
from taichi_plume.scenario import si
from taichi_plume.scenario.belief_algorithms import (
    HitMap,
    Infotaxis,
    ParticleFilter,
    SourceTerm,
    SpaceAwareInfotaxis,
)
from taichi_plume.scenario.external import External, Replay
from taichi_plume.scenario.own_code import OwnCode
from taichi_plume.scenario.plume_tracking import Casting, Casting3D, SurgeCast, SurgeSpiral
from taichi_plume.scenario.policy import Policy
from taichi_plume.scenario.prior import Prior
from taichi_plume.scenario.search_algorithm import AnyAlgorithm, EColi, Spiral
from taichi_plume.scenario.team_algorithms import Dapso, LeastKnown, LineUp, Sweep
from taichi_plume.scenario.vocabulary import AT_START


class RandomWalk(AnyAlgorithm):
    """Straight path segments in random directions. See agents/random_walk.py."""

    kind: Literal["random_walk"]
    speed: si.Speed | None = None
    """Speed at which they drive; unless given, the body's largest. With 0 they stand and keep their heading."""
    leg: si.Length = 1.0
    """Mean length of a segment."""
    leg_spread: si.Fraction = 0.5
    """Randomness of the length: each segment is leg (1 ± leg_spread), drawn uniformly."""
    turn_angle_deg: Annotated[float, *number(0, 180, "deg")] = 180.0
    """Largest turn between segments; after a bump it is 180°."""


class Own(AnyAlgorithm, OwnCode):
    """An algorithm of the user's own: a class in a Python file, in NumPy. See agents/own_algorithm.py.

    Unless `name` gives another, the class is the only one in the file that has an `act`.
    """

    may_declare: ClassVar[bool] = True  # unknown: the class decides
    kind: Literal["own"]
    prior: Annotated[Prior | None, AT_START] = None
    """Prior of the source's position, which the class reads by `robots.prior(cell)`. Unless given it is uniform."""


Algorithm = Annotated[
    Casting
    | Casting3D
    | SurgeCast
    | SurgeSpiral
    | Spiral
    | EColi
    | Infotaxis
    | ParticleFilter
    | HitMap
    | SourceTerm
    | SpaceAwareInfotaxis
    | Dapso
    | LineUp
    | Sweep
    | LeastKnown
    | RandomWalk
    | Policy
    | External
    | Replay
    | Own,
    Field(discriminator="kind"),
]
