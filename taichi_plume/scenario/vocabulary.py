"""Base class of all sections of a scenario, and the types of its numbers with units and limits."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache, partial
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.quantities import fault
from taichi_plume.scenario.suggestions import meant_key

if TYPE_CHECKING:
    from taichi_plume.scenario.domain import Context


class Mark(Enum):
    """Annotation of a key of a scenario, such as ``Annotated[Length, AT_START]``; the value explains it."""

    AT_START = "Key that acts at the start of a run alone: `Simulation.change` refuses it, a reset takes it."
    SHAPE = """Key that gives the state of a run its meaning, such as the cells or the place of an opening:
    `Simulation.change` refuses it, a reset takes it."""
    INPUT_FILE = "Path of an input file, relative to the scenario's folder; with %d or %g, of several files."
    SPATIAL = "Key of 3-D runs alone: in 2-D its value must be zero, false or not given."
    PLANE = "Names of faces or axes, whose z does not exist in 2-D runs."


AT_START, SHAPE, INPUT_FILE, SPATIAL, PLANE = Mark


@dataclass(frozen=True)
class Vector:
    """Annotation of a list with a number per axis of the run, or of a plane in it, which has one axis `fewer`."""

    fewer: int


PER_AXIS = Vector(0)
PER_FACE = Vector(1)


def one_or_several(item: Any, most: int) -> Any:
    """Return the annotated type of a key that takes a single item or a list of up to `most`; stored as a tuple."""
    return Annotated[
        tuple[item, ...],
        Field(min_length=1, max_length=most),
        BeforeValidator(
            lambda value: value if isinstance(value, list | tuple) else (value,),
            json_schema_input_type=item | list[item],
        ),
    ]


FileName = Annotated[str, Field(min_length=1), INPUT_FILE]
Convection = Literal["koren", "weno5"]
MomentumConvection = Literal["upwind5", "koren", "weno5"]
Face = Annotated[Literal["x-", "x+", "y-", "y+", "z-", "z+"], PLANE]
Axis = Annotated[Literal["x", "y", "z"], PLANE]
Color = tuple[int, int, int]


@cache
def marked(model: type["Model"], key: str, mark: Mark) -> bool:
    """Return whether a key of a section, or a part of its type, is annotated with this mark."""
    return any(other is mark for other in _marks(model, key))


@cache
def vector(model: type["Model"], key: str) -> Vector | None:
    """Return the annotation of a key that is a list with a number per axis; None if it has no such annotation."""
    return next((mark for mark in _marks(model, key) if isinstance(mark, Vector)), None)


@cache
def _dimensional(model: type["Model"]) -> tuple[str, ...]:
    """Return the keys of a section that differ between 2-D and 3-D runs."""
    return tuple(
        key
        for key in model.model_fields
        if vector(model, key) is not None or marked(model, key, SPATIAL) or marked(model, key, PLANE)
    )


def _marks(model: type["Model"], key: str) -> Iterator[object]:
    """Yield the annotations of a key of a section and those within its type."""
    field = model.model_fields[key]
    yield from field.metadata
    yield from _annotations(field.annotation)


def _annotations(kind: object) -> Iterator[object]:
    """Yield the annotations within a type, without entering the classes of sections."""
    if get_origin(kind) is Annotated:
        yield from get_args(kind)[1:]
    for part in get_args(kind):
        yield from _annotations(part)


class Model(BaseModel):
    """A frozen section of a scenario."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)  # unused sections are not built

    @property
    def by_chance(self) -> bool:
        """Whether the section draws random values from the seed; by default, whether a section within it does."""
        values = (value if isinstance(value, tuple) else (value,) for value in vars(self).values())
        return any(part.by_chance for parts in values for part in parts if isinstance(part, Model))

    def model_copy(self, *, update: Mapping[str, object] | None = None, deep: bool = False) -> Self:
        """Return a copy with the values in `update`. Raises ScenarioError, with a line per unknown key or bad value."""
        # these import this module
        from taichi_plume.scenario.error_messages import explain
        from taichi_plume.scenario.loading import ScenarioError, of_python

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
                f"{type(self).__name__}.{name} cannot be set; scenario.with_({{'seed': 3}}) returns a scenario with "
                "other values"
            )
        super().__setattr__(name, value)

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: Any, handler: Any) -> Any:
        from taichi_plume.scenario.key_facts import facts  # imports this module

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

    def dimension_errors(self, where: str, dim: int) -> Iterator[str]:
        """Yield an error for each key that does not fit a run in `dim` dimensions; where: path of the section.

        An error is a line: path of the key, what is wrong, and what is allowed. The same holds for
        `errors`.
        """
        model = type(self)
        for key in _dimensional(model):
            axes, value = vector(model, key), vars(self)[key]
            if axes is not None and value is not None and len(value) != dim - axes.fewer:
                has = f"{len(value)} number{'s' * (len(value) > 1)}"
                names = "along the face" if axes.fewer else "x and y" if dim == 2 else "x, y and z"
                yield f"{where}.{key}: has {has}, a {dim}-D run takes {dim - axes.fewer} here: {names}"
            if dim == 2 and value and marked(model, key, SPATIAL):
                yield f"{where}.{key}: is for 3-D runs; remove it, or give domain.size three numbers"
            if dim == 2 and value and marked(model, key, PLANE):
                for n, name in enumerate(value if isinstance(value, tuple) else (value,)):
                    if name[0] == "z":
                        place = f"[{n}]" * isinstance(value, tuple)
                        yield f"{where}.{key}{place}: '{name}' does not exist in a 2-D run; use x or y"

    def errors(self, where: str, context: "Context") -> Iterator[str]:
        """Yield the errors of a section, which do not depend on its file; none by default."""
        yield from ()

    def warnings(self, where: str, context: "Context") -> Iterator[str]:
        """Yield warnings about values that are allowed but probably not meant, of a section without errors."""
        yield from ()


def consistency_check(errors: Callable[[Any], Iterator[str]]) -> Any:
    """Return a pydantic validator of a section that raises the first error which this method or function yields."""

    def check(section: Model) -> Model:
        if line := next(errors(section), ""):
            raise fault(line)
        return section

    return model_validator(mode="after")(check)


def exactly_one(*keys: str, least: int = 1) -> Any:
    """Return a pydantic validator: exactly one of two keys must be given; with least=0, at most one."""

    @consistency_check
    def check(section: Model) -> Iterator[str]:
        given = [key for key in keys if vars(section)[key] is not None]
        if not least <= len(given) <= 1:
            yield f"takes {' or '.join(keys)}, got {'both' if given else 'neither'}"

    return check


not_both = partial(exactly_one, least=0)


def stop_after_start() -> Any:
    """Return a pydantic validator: the time `stop` must be later than `start`, if both are given."""

    @consistency_check
    def check(section: Model) -> Iterator[str]:
        start, stop = vars(section)["start"], vars(section)["stop"]
        if start is not None and stop is not None and stop <= start:
            yield "stop must be later than start"

    return check


def ordered_schedule() -> Any:
    """Return a pydantic validator: the changes in `schedule` must be ordered by their times `at`."""

    @consistency_check
    def check(section: Model) -> Iterator[str]:
        times = [step.at for step in vars(section)["schedule"]]
        if times != sorted(times):
            yield "schedule must be ordered by 'at'"

    return check


@cache
def _with_sections(model: type[Model]) -> tuple[str, ...]:
    """Return the keys of a section whose values may be or contain sections."""
    fields = model.model_fields.items()
    return tuple(key for key, field in fields if any(map(_is_section, _parts(field.annotation))))


def _parts(kind: object) -> Iterator[object]:
    """Yield a type and all types that it is made of, without those in the classes of sections."""
    yield kind
    for part in get_args(kind):
        yield from _parts(part)


def _is_section(kind: object) -> bool:
    return isinstance(kind, type) and issubclass(kind, Model)


def sections(part: object, where: str) -> Iterator[tuple[str, Model]]:
    """Yield (path, section) for a section, or those of a list, and for all sections inside; where: its path."""
    if isinstance(part, Model):
        yield where, part
        for key in _with_sections(type(part)):
            yield from sections(vars(part)[key], f"{where}.{key}")
    elif isinstance(part, tuple) and part and isinstance(part[0], Model):
        for n, item in enumerate(part):
            yield from sections(item, f"{where}[{n}]")
