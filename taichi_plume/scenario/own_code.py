"""Sections that Python code of the user computes: search algorithms, laws of gas and wind."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from taichi_plume.quantities import fault
from taichi_plume.scenario.changes import ValueLineError, yaml_value
from taichi_plume.scenario.sources import OneGas, Target
from taichi_plume.scenario.vocabulary import INPUT_FILE, Model
from taichi_plume.scenario.wind_base import AnyWind

LEVELS = 4  # of nesting above the parameters in a file: robots, a group, algorithm, parameters


def _writable(value: object) -> object:
    """Return parameters of user's code, which scenario.yaml keeps as they are. Raises PydanticCustomError."""
    if not isinstance(value, dict):
        return value
    try:
        return yaml_value(value, exact=True, above=LEVELS)
    except ValueLineError as error:
        raise fault("{what}", {"what": error.what, "below": error.steps}) from None


class OwnCode(Model):
    """Base class of sections that name Python code of the user's own, in NumPy."""

    file: Annotated[str, INPUT_FILE] = ""
    """Path of the Python file, relative to the scenario's folder. Empty if Python code passes the code itself."""
    name: str | None = None
    """Name of the class or function in the file."""
    parameters: Annotated[dict[str, Any], BeforeValidator(_writable)] = Field(default_factory=dict)
    """Keyword arguments of the code, by their names. A value is a text, a finite number, true, false, null, a list,
    or a mapping whose keys are texts; nothing is converted, so that a repeated run has equal values."""


class OwnLaw(OwnCode):
    """Base class of laws of gas and wind: functions of positions and time. See solvers/own_laws.py."""

    function: ClassVar[str]
    """Name of the function in the file unless `name` gives another."""


class OwnGas(OneGas, OwnLaw):
    """Gas by a law of the user's own: ``concentration(points, t)`` in ppm, computed in every cell at every tick."""

    kind: Literal["own"]
    function: ClassVar[str] = "concentration"
    sources: tuple[Target, ...] = ()
    """Places that robots search for; they emit nothing, the law gives the gas."""


class OwnWind(AnyWind, OwnLaw):
    """Wind by a law of the user's own: ``velocity(points, t)`` in m/s, computed at the faces of all cells.

    The velocities are made divergence-free at every tick, so that the wind can carry gas.
    """

    kind: Literal["own"]
    function: ClassVar[str] = "velocity"
