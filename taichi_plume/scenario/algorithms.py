"""The search algorithms of a scenario and their parameters."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from taichi_plume.scenario.belief_algorithms import HitMap, Infotaxis, ParticleFilter, SpaceAwareInfotaxis
from taichi_plume.scenario.external import External, Replay
from taichi_plume.scenario.listening import AnyAlgorithm, EColi, Spiral
from taichi_plume.scenario.plume_tracking import Casting, Casting3D, SurgeCast, SurgeSpiral
from taichi_plume.scenario.policy import Policy
from taichi_plume.scenario.quantities import number
from taichi_plume.scenario.team_algorithms import Dapso, LeastKnown, LineUp, Sweep
from taichi_plume.scenario.vocabulary import (
    INPUT_FILE,
    Fraction,
    Length,
    Speed,
)

if TYPE_CHECKING:
    pass


class RandomWalk(AnyAlgorithm):
    """Straight legs in random directions. See agents/random_walk.py."""

    kind: Literal["random_walk"]
    speed: Speed | None = None
    """Speed at which they drive; unless given, the body's largest. With 0 they stand, and keep their heading too."""
    leg: Length = 1.0
    """Mean length of a leg."""
    leg_spread: Fraction = 0.5
    """Randomness of the length: each leg is leg (1 ± leg_spread), drawn uniformly."""
    turn_angle_deg: number(0, 180, "deg") = 180.0
    """Largest turn between legs; after a bump it is 180°."""


class Own(AnyAlgorithm):
    """An algorithm of the user's own: a class in a Python file, in NumPy. See agents/own.py."""

    kind: Literal["own"]
    file: Annotated[str, INPUT_FILE] = ""
    """Path of the Python file, relative to the scenario's folder. Empty where the class is handed over in Python."""
    name: str | None = None
    """Name of the class; unless given, the only one in the file that has an `act`."""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """Keywords that the class is made with, by their names."""

    @property
    def may_declare(self) -> bool:
        """Whether its robots may say where a source is: what a class does is not known before."""
        return True


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
