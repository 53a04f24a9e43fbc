"""The search algorithms that robots of a scenario may use, and their parameters."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from taichi_plume.scenario import si
from taichi_plume.scenario.belief_algorithms import HitMap, Infotaxis, ParticleFilter, SpaceAwareInfotaxis
from taichi_plume.scenario.changes import ValueLineError, yaml_value
from taichi_plume.scenario.external import External, Replay
from taichi_plume.scenario.plume_tracking import Casting, Casting3D, SurgeCast, SurgeSpiral
from taichi_plume.scenario.policy import Policy
from taichi_plume.scenario.quantities import fault, number
from taichi_plume.scenario.search_algorithm import AnyAlgorithm, EColi, Spiral
from taichi_plume.scenario.team_algorithms import Dapso, LeastKnown, LineUp, Sweep
from taichi_plume.scenario.vocabulary import INPUT_FILE


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


LEVELS = 4  # of nesting above the parameters in a file: robots, a group, algorithm, parameters


def _writable(value: object) -> object:
    """Return parameters of a user's algorithm, which scenario.yaml keeps as they are. Raises PydanticCustomError."""
    if not isinstance(value, dict):
        return value
    try:
        return yaml_value(value, exact=True, above=LEVELS)
    except ValueLineError as error:
        raise fault("{what}", {"what": error.what, "below": error.steps}) from None


class Own(AnyAlgorithm):
    """An algorithm of the user's own: a class in a Python file, in NumPy. See agents/own_algorithm.py."""

    may_declare: ClassVar[bool] = True  # unknown: the class decides
    kind: Literal["own"]
    file: Annotated[str, INPUT_FILE] = ""
    """Path of the Python file, relative to the scenario's folder. Empty if Python code passes the class."""
    name: str | None = None
    """Name of the class; unless given, the only one in the file that has an `act`."""
    parameters: Annotated[dict[str, Any], BeforeValidator(_writable)] = Field(default_factory=dict)
    """Keyword arguments of the class, by their names. A value is a text, a finite number, true, false, null, a list,
    or a mapping whose keys are texts; nothing is converted, so that a repeated run has equal values."""


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
