"""Limits of the numbers of a scenario, wide but finite, and marks of lists with a number per axis."""

from typing import Annotated, Any, get_args, get_origin

import pytest
from annotated_types import MaxLen
from pydantic import TypeAdapter, ValidationError

from taichi_plume.scenario import si
from taichi_plume.scenario.key_facts import _numbers, _whole
from taichi_plume.scenario.keys import places
from taichi_plume.scenario.vocabulary import PER_AXIS, PER_FACE, Model, vector


def vocabulary() -> list[type[Model]]:
    """All sections, by their names."""
    return sorted(
        {model for place in places().values() for model in place.models}, key=lambda model: model.__name__
    )


NUMBERS = [
    (f"{model.__name__}.{key}", Annotated[(kind, *marks)] if marks else kind)
    for model in vocabulary()
    for key, field in model.model_fields.items()
    for kind, marks in _numbers(_whole(field))
    if kind is not str
]


def refused(kind: Any, value: float) -> bool:
    try:
        TypeAdapter(kind).validate_python(value)
    except ValidationError:
        return True
    return False


def test_numbers_of_all_sorts_are_found():
    names = {name for name, _ in NUMBERS}
    assert len(names) > 300
    assert {
        "Domain.size", "Domain.depth", "CfdWind.courant", "Gusts.intensity", "GaussianPlumeGas.diffusivity",
        "MoxSensor.sensitivity", "Motion.path", "Body.max_acceleration", "Recording.range_ppm", "Group.count",
    } <= names  # fmt: skip


@pytest.mark.parametrize("far", [1e30, -1e30])
def test_every_number_has_limits_on_both_sides(far):
    assert not {
        name for name, kind in NUMBERS if not refused(kind, int(far) if get_args(kind)[:1] == (int,) else far)
    }


def test_a_delay_is_zero_or_can_be_a_divisor():
    read = TypeAdapter(si.Delay).validate_python
    assert read(0) == 0.0
    assert read("1 ms") == 0.001
    with pytest.raises(ValidationError, match="got 1e-100 s; 0, or at least 1e-06 s"):
        read(1e-100)


def test_what_cannot_be_zero_cannot_be_all_but_zero():
    """It would be zero in single precision, or make more cells and ticks than there are."""
    assert not {name for name, kind in NUMBERS if refused(kind, 0.0) and not refused(kind, 1e-30)}


# ---------------------------------------------------------------- a number per axis

OTHERS = {
    "Domain.size": "which sets the dimension",
    "ClosedForm.diffusivity": "of which one may stand for all axes",
    "ClosedForm.intensity": "the same",
    "Recording.slice_height": "of one slice or several",
    "Policy.memory": "one per average",
    "Spiral.arms": "a list of any length",
    "TableProfile.heights": "a list of any length",
    "TableProfile.speeds": "one per height",
    "Prism.vertices": "of two each, in any run",
    "PriorArea.vertices": "of two each, in any run",
    "Prior.values": "rows of any length",
    "Motion.path": "of three each, in any run",
    "StartAt.positions": "of two each, in any run",
    "RangeSensors.bearings_deg": "one per sensor",
    "ImportedWind.missing": "a list of any length",
}
"""Lists of numbers that are no vectors, though none has a fixed length."""


def is_list(kind: Any) -> bool:
    """Whether a type is, or contains, a list of numbers of no fixed length."""
    if get_origin(kind) is tuple:
        items = get_args(kind)
        return len(items) == 2 and items[1] is Ellipsis and has_floats(items[0])
    return any(is_list(part) for part in get_args(kind)) if get_origin(kind) is not dict else False


def has_floats(kind: Any) -> bool:
    return kind is float or any(has_floats(part) for part in get_args(kind))


def annotations(kind: Any) -> list[Any]:
    own = get_args(kind)[1:] if get_origin(kind) is Annotated else ()
    return [one for meta in own for one in getattr(meta, "metadata", [meta])] + [
        one for part in get_args(kind) for one in annotations(part)
    ]


def test_every_list_of_numbers_says_whether_it_is_a_vector():
    marked = {}
    for model in vocabulary():
        for key, field in model.model_fields.items():
            if is_list(field.annotation):
                mark = vector(model, key)
                names = {f"{base.__name__}.{key}" for base in model.__mro__}
                assert (mark is None) == bool(names & OTHERS.keys()), (
                    f"{model.__name__}.{key}: {field.annotation}"
                )
                marked[f"{model.__name__}.{key}"] = mark
            if (mark := vector(model, key)) is not None:
                limits = [
                    one
                    for one in (*field.metadata, *annotations(field.annotation))
                    if isinstance(one, MaxLen)
                ]
                assert [one.max_length for one in limits] == [3 - mark.fewer], f"{model.__name__}.{key}"
    assert marked["Source.position"] is marked["Box.size"] is marked["UniformWind.velocity"] is PER_AXIS
    assert marked["Fan.center"] is marked["Straightener.size"] is marked["TemperedWall.center"] is PER_FACE
    assert len([mark for mark in marked.values() if mark]) > 20
