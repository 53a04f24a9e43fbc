"""Lists of numbers that are one per axis are marked so, wherever they are in the vocabulary."""

from typing import Annotated, Any, get_args, get_origin

from annotated_types import MaxLen
from test_reset import vocabulary

from taichi_plume.scenario.vocabulary import PER_AXIS, PER_FACE, Vector, mark_of

OTHERS = {
    "Domain.size": "which tells the dimension",
    "ClosedForm.diffusivity": "of which one may stand for all axes",
    "ClosedForm.intensity": "the same",
    "Recording.slice_height": "of one slice or several",
    "Policy.memory": "one per average",
    "Spiral.arms": "a list of any length",
    "TableProfile.heights": "a list of any length",
    "TableProfile.speeds": "one per height",
    "Prism.vertices": "of two each, in any run",
    "Motion.path": "of three each, in any run",
    "StartAt.positions": "of two each, in any run",
}
"""Lists of numbers that are no vectors, though none has a fixed length."""


def lengths(kind: Any) -> bool:
    """Whether a type is a list of numbers of no fixed length, or has one."""
    if get_origin(kind) is tuple:
        items = get_args(kind)
        return len(items) == 2 and items[1] is Ellipsis and floats(items[0])
    return any(lengths(part) for part in get_args(kind)) if get_origin(kind) is not dict else False


def floats(kind: Any) -> bool:
    return kind is float or any(floats(part) for part in get_args(kind))


def test_every_list_of_numbers_says_whether_it_is_a_vector():
    marked = {}
    for model in vocabulary():
        for key, field in model.model_fields.items():
            if lengths(field.annotation):
                mark = mark_of(model, key, Vector)
                names = {f"{base.__name__}.{key}" for base in model.__mro__}
                assert (mark is None) == bool(names & OTHERS.keys()), (
                    f"{model.__name__}.{key}: {field.annotation}"
                )
                marked[f"{model.__name__}.{key}"] = mark
    assert marked["Source.position"] is marked["Box.size"] is marked["UniformWind.velocity"] is PER_AXIS
    assert marked["Fan.center"] is marked["Straightener.size"] is marked["TemperedWall.center"] is PER_FACE
    assert len([mark for mark in marked.values() if mark]) > 20


def test_vectors_have_no_more_numbers_than_a_run_has_axes():
    for model in vocabulary():
        for key, field in model.model_fields.items():
            mark = mark_of(model, key, Vector)
            kinds = [
                one for one in (*field.metadata, *_annotations(field.annotation)) if isinstance(one, MaxLen)
            ]
            if mark is not None:
                assert [kind.max_length for kind in kinds] == [3 - mark.fewer], f"{model.__name__}.{key}"


def _annotations(kind: Any) -> list[Any]:
    own = list(getattr(kind, "__metadata__", ())) if get_origin(kind) is Annotated else []
    found = [one for meta in own for one in getattr(meta, "metadata", [meta])]
    return found + [one for part in get_args(kind) for one in _annotations(part)]
