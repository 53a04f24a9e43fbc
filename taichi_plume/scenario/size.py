"""How large a scenario is: numbers of coordinates, cells, memory, and roughly how long it takes.

Nothing here allocates.
"""

from collections.abc import Iterator
from math import ceil, prod

import psutil

from taichi_plume.scenario.quantities import round_up
from taichi_plume.scenario.scenario import Scenario

BYTES_PER_CELL = {2: 280, 3: 520}  # of a CFD run with one gas, at its peak while it is set up
BYTES_PER_GAS = 16  # and cell, of every further gas
BYTES_OF_FACTORS = 700  # per cell of a 2-D flow solved by sparse factors, at 10⁵ cells; it grows slowly
BYTES_PER_ROBOT = 2000  # state, readings and a few minutes of track
CELL_STEPS_PER_SECOND = {2: 3e6, 3: 5e6}  # rough: wind and gas on a few CPU cores


def estimate(scenario: Scenario) -> dict[str, float]:
    """Rough size of a run: cells, bytes, steps of the flow, and seconds it takes on a few CPU cores."""
    domain, wind, tick = scenario.domain, scenario.wind, scenario.tick
    cells = prod(domain.shape)
    whole = scenario.warm_up + scenario.duration
    substeps = max(1, ceil(tick / wind.longest_step(scenario) - 1e-9))
    steps = ceil(whole / tick - 1e-9) + (substeps - 1) * ceil(wind.moving(whole) / tick - 1e-9)
    return {
        "cells": cells,
        "bytes": _bytes(scenario, cells),
        "steps": steps,
        "wall_s": cells * steps / CELL_STEPS_PER_SECOND[domain.dim],
    }


def _bytes(scenario: Scenario, cells: float) -> float:
    per_cell = BYTES_PER_CELL[scenario.domain.dim] + (BYTES_OF_FACTORS if _has_factors(scenario) else 0)
    per_cell += BYTES_PER_GAS * (len(scenario.gases) - 1)
    return cells * per_cell + _robots(scenario) * BYTES_PER_ROBOT


def _robots(scenario: Scenario) -> int:
    return sum(group.count * group.trials for group in scenario.robots)


def _has_factors(scenario: Scenario) -> bool:
    """Whether a 2-D flow is too irregular for fast transforms: obstacles, or faces of the domain open in part."""
    if scenario.domain.dim == 3 or scenario.wind.computed is None:
        return False
    exits = [opening.region for opening in scenario.openings if opening.lets_out]
    standing = any(one.motion is None for one in scenario.obstacles)
    return standing or any(region is not None and region.center is not None for region in exits)


def too_large(scenario: Scenario) -> Iterator[str]:
    """Cells and memory that are too many or too few."""
    domain = scenario.domain
    cells = prod(max(1.0, extent / domain.spacing) for extent in domain.size)
    needed, free = _bytes(scenario, cells), psutil.virtual_memory().available
    if needed > free:
        if _bytes(scenario, 0) > free / 2:
            yield (
                f"robots: {_robots(scenario)} robots in all trials need {_memory(needed)} of memory, "
                f"{_memory(free)} are free; lower count or trials"
            )
        else:
            fits = max(domain.spacing, 1e-9 * max(domain.size))
            while _bytes(scenario, prod(max(1.0, extent / fits) for extent in domain.size)) > free:
                fits *= 1.05
            yield (
                f"domain.spacing: {cells:.3g} cells need {_memory(needed)} of memory, "
                f"{_memory(free)} are free; a spacing of {round_up(fits):g} m fits"
            )
        return
    trials = (sum if scenario.rivals else max)([group.trials for group in scenario.robots] or [1])
    for n, gas_map in enumerate(scenario.maps):
        line = gas_map.too_fine(f"maps[{n}]", domain.size)
        if line is not None:
            yield line
        elif (of_map := trials * gas_map.bytes(domain.size)) > free:
            yield (
                f"maps[{n}]: needs {_memory(of_map)} of memory for all trials, {_memory(free)} are free; "
                "make its cells larger, or lower the trials"
            )
    yield from domain.rounded("domain")


def _memory(amount: float) -> str:
    return f"{amount / 1e9:,.0f} GB" if amount >= 1e11 else f"{amount / 1e9:.2g} GB"
