"""What is wrong with a scenario beyond single keys: each section tells it of itself, see `vocabulary.Model`."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from taichi_plume.scenario import unlikely
from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.size import too_large
from taichi_plume.scenario.vocabulary import Model, sections

if TYPE_CHECKING:
    from taichi_plume.assembly.resources import Resources

FIRST = ("obstacles", "gas", "arena", "robots", "wind")  # what lies in the room, before the air in it


def every(scenario: Scenario) -> Iterator[tuple[str, Model]]:
    """Every section with its path, in the order in which they are told of; the scenario itself comes last."""
    for key in sorted(
        Scenario.model_fields, key=lambda key: FIRST.index(key) if key in FIRST else len(FIRST)
    ):
        yield from sections(vars(scenario)[key], key)
    yield "", scenario


def misfits(scenario: Scenario) -> list[str]:
    """What goes with another dimension, or does not fit in memory; nothing has been opened yet.

    All faults are lines ``path: message``.
    """
    dim = scenario.domain.dim
    lines = [line for where, section in every(scenario) for line in section.misfits(where, dim)]
    return lines or list(too_large(scenario))


def remarks(scenario: Scenario, resources: "Resources") -> list[str]:
    """What of a scenario, of which nothing is wrong, is probably not meant: lines ``path: message``."""
    context = Context(scenario, resources)
    lines = [line for where, section in every(scenario) for line in section.remarks(where, context)]
    return [*lines, *unlikely.remarks(context)]


def problems(scenario: Scenario, resources: "Resources") -> list[str]:
    """Return what else is wrong with a scenario whose files have been opened.

    Files that cannot be used are reported alone: the other checks need all files and shapes.
    """
    context = Context(scenario, resources)
    if resources.faults:
        return [f"{path}: {fault}" for path, fault in resources.faults.items()]
    lines = [line for where, section in every(scenario) for line in section.unusable(where, context)]
    return lines or [line for where, section in every(scenario) for line in section.problems(where, context)]
