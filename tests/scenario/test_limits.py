"""Every number of a scenario has limits, wide but finite: nonsense is refused where it is written."""

import types
from collections.abc import Iterator
from typing import Annotated, Any, Union, get_args, get_origin

import pytest
from pydantic import TypeAdapter, ValidationError

from taichi_plume.scenario import scenario  # noqa: F401  # all sections
from taichi_plume.scenario.vocabulary import Delay, Model
from taichi_plume.scenario.winds import Wind


def sections(model: type[Model] = Model) -> Iterator[type[Model]]:
    for one in model.__subclasses__():
        if one.__module__.startswith("taichi_plume.scenario"):
            yield one
        yield from sections(one)


def numbers(kind: Any, marks: tuple = ()) -> Iterator[Any]:
    """The floats and integers that a type holds, each with what it is annotated with on the way."""
    if get_origin(kind) is Annotated:
        bare, *more = get_args(kind)
        inner = tuple if get_origin(bare) in (tuple, dict) else object
        yield from numbers(bare, () if inner is tuple else (*marks, *more))
    elif kind in (float, int):
        yield Annotated[(kind, *marks)] if marks else kind
    elif get_origin(kind) in (Union, types.UnionType, tuple, dict):
        for part in get_args(kind):
            yield from numbers(part, marks if get_origin(kind) in (Union, types.UnionType) else ())


KEYS = [
    (f"{section.__name__}.{key}", kind)
    for section in sorted(set(sections()), key=lambda one: one.__name__)
    for key, field in section.model_fields.items()
    for kind in numbers(
        Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation
    )
]


def refused(kind: Any, value: float) -> bool:
    try:
        TypeAdapter(kind).validate_python(value)
    except ValidationError:
        return True
    return False


def test_the_walk_finds_numbers_of_all_sorts():
    names = {name for name, _ in KEYS}
    assert len(names) > 300
    assert {
        "Domain.size", "Domain.depth", "CfdWind.courant", "Gusts.intensity", "GaussianPlumeGas.diffusivity",
        "MoxSensor.sensitivity", "Motion.path", "Body.max_acceleration", "Recording.range_ppm", "Group.count",
    } <= names  # fmt: skip


@pytest.mark.parametrize("far", [1e30, -1e30])
def test_every_number_has_limits_on_both_sides(far):
    boundless = {name for name, kind in KEYS if not refused(kind, int(far) if kind is int else far)}
    assert not boundless


def test_a_time_is_none_at_all_or_one_that_can_be_divided_by():
    read = TypeAdapter(Delay).validate_python
    assert read(0) == 0.0
    assert read("1 ms") == 0.001
    with pytest.raises(ValidationError, match="got 1e-100 s; 0, or at least 1e-06 s"):
        read(1e-100)


def test_what_cannot_be_zero_cannot_be_all_but_zero():
    """It would be zero in single precision, or make more cells and ticks than there are."""
    tiny = {name for name, kind in KEYS if refused(kind, 0.0) and not refused(kind, 1e-30)}
    assert not tiny


@pytest.mark.parametrize(
    ("section", "told"),
    [
        (
            {"kind": "cfd", "viscosity": 15.6},
            "got 15.6 m^2/s; did you mean '15.6 mm^2/s'? at most 1 m^2/s",
        ),
        ({"kind": "uniform", "velocity": [1e30, 0]}, "got 1e+30 m/s; at most 100 m/s"),
        (
            {"kind": "uniform", "velocity": [-700, 0]},
            "got -700 m/s; did you mean '-700 mm/s'? at least -100 m/s",
        ),
    ],
)
def test_a_unit_is_guessed_where_it_makes_sense(section, told):
    with pytest.raises(ValidationError) as error:
        TypeAdapter(Wind).validate_python(section)
    assert told in [one["msg"] for one in error.value.errors()]
