"""Base class of all sections of a scenario, and the types of its numbers with units and limits."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeVar, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.scenario.quantities import fault, number, quantity
from taichi_plume.scenario.suggestions import meant_key

if TYPE_CHECKING:
    from taichi_plume.scenario.domain import Context

Mark = TypeVar("Mark")


class Compiled:
    """Mark of a number (as ``Annotated[Length, COMPILED]``) on which shapes of fields, tables or kernels depend.

    They depend on kinds, names, counts and lengths of lists anyway. All other numbers reach kernels at run time: a
    reset may change them, see `Simulation.reset`.
    """


class Free:
    """Mark of a key that a reset may change, with all below it, although its value is no float."""


class InputFile:
    """Mark of the path of an input file, relative to the scenario's folder; with %d or %g, of several files."""


class Spatial:
    """Mark of a key that is of 3-D runs alone: in 2-D its value must be zero, false or not given."""


class Plane:
    """Mark of names of faces or axes, whose z does not exist in 2-D runs."""


COMPILED, FREE, INPUT_FILE, SPATIAL = Compiled(), Free(), InputFile(), Spatial()


@dataclass(frozen=True)
class Vector:
    """Mark of a list with a number per axis of the run, or of a plane in it, which has one axis `fewer`."""

    fewer: int


PER_AXIS = Vector(0)
PER_FACE = Vector(1)


def one_or_several(item: Any, most: int) -> Any:
    """Return the annotated type of a single item, or of a list of up to `most` of them."""
    return Annotated[
        tuple[item, ...],
        Field(min_length=1, max_length=most),
        BeforeValidator(
            lambda value: value if isinstance(value, list | tuple) else (value,),
            json_schema_input_type=item | list[item],
        ),
    ]


# Each kind of quantity with its limits: wide (micrometres to 100 km, seconds to decades) but finite, as a value beyond
# them is a slip of the unit or the keyboard. Coordinates may be those of a map.
Coordinate = quantity("m", least=-1e7, most=1e7)
Length = quantity("m", gt=0, least=1e-6, most=1e5, likely="mm")
Distance = quantity("m", ge=0, most=1e5, likely="mm")
BodyLength = quantity("m", gt=0, least=1e-3, most=100, likely="mm")  # of robots: contact is 0.1 mm
Duration = quantity("s", gt=0, least=1e-6, most=1e9)
Time = quantity("s", least=-1e9, most=1e9)
Delay = quantity("s", ge=0, least=1e-6, most=1e9, or_zero=True)
Wait = quantity("s", gt=0, least=1e-6, most=1e5)  # robots count it in ticks, in 32 bits
Pause = quantity("s", ge=0, most=1e5)  # likewise
Speed = quantity("m/s", ge=0, most=100, likely="mm/s")  # air is incompressible up to about there
Velocity = quantity("m/s", least=-100, most=100, likely="mm/s")
Acceleration = quantity("m/s^2", least=-1000, most=1000)
Thrust = quantity("m/s^2", gt=0, least=1e-6, most=1e4)
Rate = quantity("kg/s", ge=0, most=1, likely="mg/s")
Mass = quantity("kg", ge=0, most=1, likely="mg")
BodyMass = quantity("kg", gt=0, least=1e-4, most=1000, likely="g")
Frequency = quantity("1/s", gt=0, least=1e-9, most=1e6)
MolarMass = quantity("kg/mol", gt=0, least=1e-3, most=1, likely="g/mol")
Pressure = quantity("Pa", gt=0, least=1e-9, most=1e6)
FlowRate = quantity("m^3/s", gt=0, least=1e-9, most=1000, likely="m^3/h")
TopSpeed = quantity("m/s", gt=0, least=1e-6, most=100, likely="mm/s")
Tick = quantity("s", gt=0, le=1, least=1e-4)
Viscosity = quantity("m^2/s", ge=0, most=1, likely="mm^2/s")  # as much as an exact solution may ask for
Diffusivity = quantity("m^2/s", ge=0, most=1, likely="mm^2/s")  # of molecules
EddyDiffusivity = quantity("m^2/s", ge=0, most=1e4)
Dissipation = quantity("m^2/s^3", gt=0, least=1e-12, most=1e3)
Temperature = quantity("K", least=200, likely="degC", most=500)
Power = quantity("W", least=-1e7, most=1e7)
SurfaceVelocity = quantity("m/s", gt=0, least=1e-9, most=1, likely="mm/s")  # of gas that reaches a surface
Concentration = quantity("ppm", ge=0, most=1e6)
HeatTransfer = quantity("W/m^2/K", gt=0, least=1e-6, most=1e6)
HeatCapacity = quantity("J/m^3/K", gt=0, least=1, most=1e8)
Resistance = quantity("ohm", gt=0, least=1, most=1e9)
LatentHeat = quantity("J/kg", gt=0, least=1e4, most=1e8, likely="MJ/kg")
Expansion = quantity("1/K", ge=0, most=1)
Fraction = number(0, 1)
SomeFraction = number(1e-6, 1)
Angle = number(-1e4, 1e4, "deg")
AngleNoise = number(0, 1e4, "deg")
TurnRate = number(1e-3, 1e6, "deg/s")
Ppm = Concentration
SomePpm = quantity("ppm", gt=0, least=1e-9, most=1e6)
FullScale = quantity("ppm", gt=0, least=1e-6, most=1e6)
Intensity = number(0, 10)
Coefficient = number(0, 1e6)
SomeCoefficient = number(1e-6, 1e6)
Prandtl = number(0.01, 100)
Exponent = number(0.01, 10)
Swirl = number(-100, 100)
Magnitude = number(1e-12, 1e12)  # in a unit of someone else's
Count = Annotated[int, Field(ge=1, le=1_000_000)]
Point = Annotated[tuple[Coordinate, ...], Field(min_length=2, max_length=3), PER_AXIS]
Edges = Annotated[tuple[Length, ...], Field(min_length=2, max_length=3), PER_AXIS]
Velocities = Annotated[tuple[Velocity, ...], Field(min_length=2, max_length=3), PER_AXIS]
Accelerations = Annotated[tuple[Acceleration, ...], Field(min_length=2, max_length=3), PER_AXIS]
Point2 = tuple[Coordinate, Coordinate]
FileName = Annotated[str, Field(min_length=1), INPUT_FILE]
Convection = Literal["koren", "weno5"]
MomentumConvection = Literal["upwind5", "koren", "weno5"]
Face = Annotated[Literal["x-", "x+", "y-", "y+", "z-", "z+"], Plane()]
Axis = Annotated[Literal["x", "y", "z"], Plane()]
Color = tuple[int, int, int]
Diffusivities = one_or_several(EddyDiffusivity, 3)
Intensities = one_or_several(Intensity, 3)


@cache
def mark_of(model: type["Model"], key: str, kind: type[Mark]) -> Mark | None:
    """Return the mark of this class on a key of a model, or on a part of its type; None if there is none."""
    field = model.model_fields[key]
    return next(
        (mark for mark in (*field.metadata, *_marks(field.annotation)) if isinstance(mark, kind)), None
    )


def marked(model: type["Model"], key: str, kind: type) -> bool:
    """Return whether a key of a model, or a part of its type, has a mark of this class."""
    return mark_of(model, key, kind) is not None


def _marks(kind: object) -> Iterator[object]:
    """Yield the annotations within a type, outside of models."""
    if get_origin(kind) is Annotated:
        yield from get_args(kind)[1:]
    for part in get_args(kind):
        yield from _marks(part)


class Model(BaseModel):
    """A frozen section of a scenario."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)  # unused sections are not built

    @property
    def by_chance(self) -> bool:
        """Whether something is drawn from the seed: by default, whether a part of the section does so."""
        values = (value if isinstance(value, tuple) else (value,) for value in vars(self).values())
        return any(part.by_chance for parts in values for part in parts if isinstance(part, Model))

    def model_copy(self, *, update: Mapping[str, object] | None = None, deep: bool = False) -> Self:
        """Return a copy with other values. Raises ScenarioError, with a line per unknown key and bad value."""
        from taichi_plume.scenario.loading import ScenarioError, explain, of_python  # it imports this module

        if not update:
            return super().model_copy(deep=deep)
        data = {key: vars(self)[key] for key in self.model_fields_set} | of_python(update)
        try:
            return type(self).model_validate(data)
        except ValidationError as error:
            raise ScenarioError(explain(error, data, type(self))) from None

    def __setattr__(self, name: str, value: object) -> None:
        """Raise AttributeError: sections are frozen. Pydantic's own attributes can be set."""
        if not name.startswith("_"):
            raise AttributeError(
                f"{type(self).__name__}.{name} cannot be set; scenario.changed({{'seed': 3}}) returns a scenario with "
                "other values"
            )
        super().__setattr__(name, value)

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: Any, handler: Any) -> Any:
        from taichi_plume.scenario.facts import facts  # imports this module

        schema = handler(core_schema)
        for key, entry in handler.resolve_ref_schema(schema)["properties"].items():
            fact = facts(cls, key)
            figures = f"\n\n{fact.figures}" if key != "kind" or fact.default else ""
            entry["description"] = fact.meaning + figures
        return schema

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: object) -> object:
        if isinstance(data, dict):
            allowed = list(cls.model_fields)
            for key in data:
                if key not in allowed:
                    close = meant_key(key, allowed)
                    hint = f"did you mean '{close}'? " if close else ""
                    raise fault(
                        "unknown key '{key}'; {hint}allowed: {allowed}",
                        {"key": visible(key, LONGEST_VALUE), "hint": hint, "allowed": ", ".join(allowed)},
                    )
        return data

    def misfits(self, where: str, dim: int) -> Iterator[str]:
        """Yield an error for each key that does not fit a run in `dim` dimensions.

        Here and below an error is a line: path of the key (`where` is that of the section), what is wrong, what is
        allowed.
        """
        model = type(self)
        for key in model.model_fields:
            vector, value = mark_of(model, key, Vector), vars(self)[key]
            if vector is not None and value is not None and len(value) != dim - vector.fewer:
                has = f"{len(value)} number{'s' * (len(value) > 1)}"
                axes = "along the face" if vector.fewer else "x and y" if dim == 2 else "x, y and z"
                yield f"{where}.{key}: has {has}, a {dim}-D run takes {dim - vector.fewer} here: {axes}"
            if dim == 2 and value and marked(model, key, Spatial):
                yield f"{where}.{key}: is for 3-D runs; remove it, or give domain.size three numbers"
            if dim == 2 and value and marked(model, key, Plane):
                for n, name in enumerate(value if isinstance(value, tuple) else (value,)):
                    if name[0] == "z":
                        place = f"[{n}]" * isinstance(value, tuple)
                        yield f"{where}.{key}{place}: '{name}' does not exist in a 2-D run; use x or y"

    def unusable(self, where: str, context: "Context") -> Iterator[str]:
        """Yield errors in the content of input files, without which the other checks are impossible."""
        yield from ()

    def problems(self, where: str, context: "Context") -> Iterator[str]:
        """Yield the other errors."""
        yield from ()

    def remarks(self, where: str, context: "Context") -> Iterator[str]:
        """Yield warnings: values that are allowed but probably not meant, of a section without errors."""
        yield from ()


def sections(part: object, where: str) -> Iterator[tuple[str, Model]]:
    """Yield a section, or those of a list, and all sections below, each with its path."""
    if isinstance(part, Model):
        yield where, part
        for key in type(part).model_fields:
            yield from sections(vars(part)[key], f"{where}.{key}")
    elif isinstance(part, tuple):
        for n, item in enumerate(part):
            yield from sections(item, f"{where}[{n}]")
