"""Size of a scenario: cells, memory, disk space, steps of the flow, and roughly how long a run takes.

Nothing here allocates.
"""

from collections.abc import Iterator
from math import ceil, prod

import psutil

from taichi_plume.scenario.probes import BYTES_PER_NUMBER
from taichi_plume.scenario.quantities import round_up
from taichi_plume.scenario.scenario import Scenario

BYTES_PER_CELL = {2: 280, 3: 520}  # of a CFD run with one gas, at its peak while it is set up
BYTES_PER_GAS = 16  # and cell, of every further gas
BYTES_OF_FACTORS = 700  # per cell of a 2-D flow solved by sparse factors, at 10⁵ cells; it grows slowly
BYTES_OF_CHANGES = 120  # per cell of a 2-D flow solved by a capacitance matrix, while that is made
BYTES_PER_ENTRY = 12  # of a capacitance matrix, in double precision and its inverse
MOST_BESIDE = 5000  # cells beside obstacles whose matrix solvers/pressure.py makes: in 6 s, 100 MB
ENTRIES_PER_CELL = 150  # of that matrix per cell of the grid, beyond which other solvers are faster
BESIDE = 1.15  # cells beside an obstacle per square of the grid that its surface has room for
BYTES_PER_ROBOT = 2000  # state, readings and a few minutes of track
BYTES_PER_PIXEL = 1.7  # and picture, of recording.rrd: measured, with arrows and tracks
MOST_PIXELS = 400  # per axis of a recorded plane
MOST_VOXELS = 96  # per axis of a recorded volume
BYTES_PER_ROW = 33  # in robots.parquet, a row per robot and tick
BYTES_OF_REPORT = 5e5
CELL_STEPS_PER_SECOND = {2: 3e6, 3: 5e6}  # rough: wind and gas on a few CPU cores


def estimate(scenario: Scenario) -> dict[str, float]:
    """Rough size of a run: cells, bytes of memory and disk, steps of the flow, and seconds on a few CPU cores."""
    domain, wind, tick = scenario.domain, scenario.wind, scenario.tick
    cells = prod(domain.shape)
    whole = scenario.warm_up + scenario.duration
    substeps = max(1, ceil(tick / wind.longest_step(scenario) - 1e-9))
    steps = ceil(whole / tick - 1e-9) + (substeps - 1) * ceil(wind.moving(whole) / tick - 1e-9)
    return {
        "cells": cells,
        "bytes": _bytes(scenario, cells),
        "disk": sum(_files(scenario).values()),
        "steps": steps,
        "step": tick / substeps,
        "wall_s": cells * steps / CELL_STEPS_PER_SECOND[domain.dim],
    }


def _bytes(scenario: Scenario, cells: float) -> float:
    domain = scenario.domain
    per_cell = BYTES_PER_CELL[domain.dim] + BYTES_PER_GAS * (len(scenario.gases) - 1)
    spacing = (prod(domain.size) / cells) ** (1.0 / domain.dim) if cells else domain.spacing
    return cells * per_cell + _of_solver(scenario, cells, spacing) + sum(_others(scenario).values())


def _files(scenario: Scenario) -> dict[str, float]:
    """Bytes of the large files of a run, by their names; without checkpoints."""
    domain, whole = scenario.domain, scenario.warm_up + scenario.duration
    films, log = scenario.fields, scenario.plumesim_log
    pixels = [min(n, MOST_PIXELS) for n in domain.shape]
    shown = float(prod(pixels))
    if domain.dim == 3:  # the floor, two heights, a section and the volume
        shown = 3.0 * pixels[0] * pixels[1] + max(pixels[:2]) * pixels[2]
        shown += prod(min(ceil(n / 2), MOST_VOXELS) for n in domain.shape) * scenario.recording.volume
    found = {
        "recording.rrd": BYTES_PER_PIXEL * shown * scenario.recording.rate * whole,
        "robots.parquet": BYTES_PER_ROW * _robots(scenario) * scenario.duration / scenario.tick,
        "report.html": BYTES_OF_REPORT,
    }
    if scenario.probes is not None:
        found["probes.parquet"] = scenario.probes.bytes(scenario)
    if films is not None:
        of_wind, of_gas = (2 * domain.dim + 1) * ("wind" in films.quantities), 2 * ("gas" in films.quantities)
        numbers = of_wind + of_gas * len(
            scenario.gases
        )  # at the cells, and on their faces for playing it again
        frames = films.rate * (scenario.duration - films.start)
        found["fields.zarr"] = BYTES_PER_NUMBER * numbers * frames * prod(domain.shape)
    if log is not None:
        nodes = prod(extent / log.cell for extent in domain.extent[:2])
        found["plume.pslog"] = 3 * BYTES_PER_NUMBER * nodes * log.rate * (scenario.duration - log.start)
    return found


def _others(scenario: Scenario) -> dict[str, float]:
    """Bytes that do not depend on the grid, by what of a scenario takes them."""
    floor, tick = scenario.floor, scenario.tick
    told = {"robots": _robots(scenario) * float(BYTES_PER_ROBOT)}
    for n, group in enumerate(scenario.robots):
        told[f"robots[{n}].algorithm"] = group.algorithm.bytes(group, floor, tick)
    for path, gas in scenario.gases:
        told[path] = gas.bytes(scenario.domain.dim)
    return told


def _robots(scenario: Scenario) -> int:
    return sum(group.count * group.trials for group in scenario.robots)


def _of_solver(scenario: Scenario, cells: float, spacing: float) -> float:
    """Bytes of what solves for the pressure, beyond fast transforms and multigrid: where obstacles stand, or faces of
    the domain are open in part, a capacitance matrix; if that is too large, sparse factors in 2-D.
    """
    domain, dim = scenario.domain, scenario.domain.dim
    if scenario.wind.computed is None or not cells:
        return 0.0
    surfaces = [one.surface(domain) for one in scenario.obstacles if one.motion is None]
    regions = [opening.region for opening in scenario.openings if opening.lets_out]
    surfaces += [one.area(domain.size, 1.0) for one in regions if one is not None and one.center is not None]
    if not surfaces:
        return 0.0
    beside = BESIDE * sum(surfaces) / spacing ** (dim - 1)
    if beside <= min(MOST_BESIDE, (ENTRIES_PER_CELL * cells) ** 0.5):
        return BYTES_PER_ENTRY * beside**2 + (BYTES_OF_CHANGES * cells if dim == 2 else 0.0)
    return BYTES_OF_FACTORS * cells if dim == 2 else 0.0


def too_large(scenario: Scenario) -> Iterator[str]:
    """Cells and memory that are too many or too few."""
    domain = scenario.domain
    cells = prod(max(1.0, extent / domain.spacing) for extent in domain.size)
    grids = list(_unfit(scenario))
    yield from grids
    if grids:
        return
    needed, free = _bytes(scenario, cells), psutil.virtual_memory().available
    if needed > free:
        if _bytes(scenario, 0) > free / 2:
            others = _others(scenario)
            most = max(others, key=others.__getitem__)
            if most == "robots":
                yield (
                    f"robots: {_robots(scenario)} robots in all trials need {memory(needed)} of memory, "
                    f"{memory(free)} are free; lower count or trials"
                )
            else:
                yield (
                    f"{most}: needs {memory(others[most])} of memory, {memory(free)} are free; make what it keeps "
                    "smaller, or use fewer robots or trials"
                )
        else:
            fits = max(domain.spacing, 1e-9 * max(domain.size))
            while _bytes(scenario, prod(max(1.0, extent / fits) for extent in domain.size)) > free:
                fits *= 1.05
            yield (
                f"domain.spacing: {cells:.3g} cells need {memory(needed)} of memory, "
                f"{memory(free)} are free; a spacing of {round_up(fits):g} m fits"
            )
        return
    trials = (sum if scenario.rivals else max)([group.trials for group in scenario.robots] or [1])
    readings = (max if scenario.rivals else sum)(
        [group.count for group in scenario.robots] or [1]
    ) / scenario.tick
    for n, gas_map in enumerate(scenario.maps):
        if (of_map := trials * gas_map.bytes(domain.size, readings)) > free:
            yield (
                f"maps[{n}]: needs {memory(of_map)} of memory for all trials, {memory(free)} are free; "
                "make its cells larger, or lower the trials"
            )
    yield from domain.rounded("domain")


def _unfit(scenario: Scenario) -> Iterator[str]:
    """Grids of algorithms and maps that have too many or too few cells."""
    domain, floor = scenario.domain, scenario.floor
    lines = [gas_map.unfit(f"maps[{n}]", domain.size) for n, gas_map in enumerate(scenario.maps)]
    if floor.fault(domain.extent) is None:
        lines += [group.algorithm.unfit(f"robots[{n}]", floor) for n, group in enumerate(scenario.robots)]
    yield from filter(None, lines)


def memory(amount: float) -> str:
    """Bytes in words."""
    if amount < 9.95e8:
        return f"{max(amount / 1e6, 1.0):.2g} MB" if amount < 9.95e7 else f"{amount / 1e6:.0f} MB"
    return f"{amount / 1e9:,.0f} GB" if amount >= 1e11 else f"{amount / 1e9:.2g} GB"
