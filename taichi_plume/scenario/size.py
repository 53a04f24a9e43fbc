"""Size of a scenario's run: cells, memory, disk space, steps and computing time, and other derived quantities."""

from collections.abc import Iterator, Mapping
from math import ceil, prod

import psutil

from taichi_plume.quantities import round_up, with_unit
from taichi_plume.scenario.localization import Camera
from taichi_plume.scenario.probes import BYTES_PER_NUMBER
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.species import AIR_VISCOSITY

BYTES_PER_CELL = {2: 280, 3: 520}  # of a CFD run with one gas, at its peak while it is set up
BYTES_PER_GAS = 16  # and cell, of every further gas
BYTES_OF_FACTORS = 700  # per cell of a 2-D flow solved by sparse factors, at 10⁵ cells; it grows slowly
BYTES_OF_CHANGES = 120  # per cell of a 2-D flow solved by a capacitance matrix, while the matrix is built
BYTES_PER_ENTRY = 12  # of a capacitance matrix, in double precision and its inverse
MOST_BESIDE = 5000  # cells beside obstacles in a matrix of solvers/pressure.py: 6 s, 100 MB
ENTRIES_PER_CELL = 150  # of that matrix per cell of the grid; with more, other solvers are faster
BESIDE = 1.15  # cells beside an obstacle over its surface in squares of the grid
BYTES_PER_ROBOT = 2000  # state, readings and a few minutes of track
BYTES_PER_POSE = 12.0  # x, y and heading in a camera's frame
BYTES_PER_VALUE = 0.6  # and picture, of pictures.zarr: measured; frames without gas take less
BYTES_PER_PIXEL = 1.7  # and picture, of recording.rrd: measured, with arrows and tracks
MOST_PIXELS = 400  # per axis of a recorded plane
MOST_VOXELS = 96  # per axis of a recorded volume
BYTES_PER_ROW = 46  # in robots.parquet, a row per robot and tick: measured, with seven decision quantities
BYTES_OF_REPORT = 5e5
PROGRAM_BYTES = 4e8  # measured: Python, Taichi and compiled kernels
CELL_STEPS_PER_SECOND = {2: 3e6, 3: 5e6}  # rough: wind and gas on a few CPU cores


def estimate(scenario: Scenario) -> dict[str, float]:
    """Return estimates for a run: cells, memory and disk [bytes], flow steps, their length [s], seconds on a CPU."""
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
    """Return the memory [bytes] of a run of the scenario if its grid had this number of cells."""
    domain = scenario.domain
    per_cell = BYTES_PER_CELL[domain.dim] + BYTES_PER_GAS * (len(scenario.gases) - 1)
    spacing = (prod(domain.size) / cells) ** (1.0 / domain.dim) if cells else domain.spacing
    return cells * per_cell + _of_solver(scenario, cells, spacing) + sum(_others(scenario).values())


def _files(scenario: Scenario) -> dict[str, float]:
    """Return the size [bytes] of each large file that a run writes, by file name; checkpoints are left out."""
    domain, whole = scenario.domain, scenario.warm_up + scenario.duration
    films, log = scenario.fields, scenario.plumesim_log
    pixels = [min(n, MOST_PIXELS) for n in domain.shape]
    shown = float(prod(pixels))
    if domain.dim == 3:  # the floor, two heights, a section and the volume
        shown = 3.0 * pixels[0] * pixels[1] + max(pixels[:2]) * pixels[2]
        shown += prod(min(ceil(n / 2), MOST_VOXELS) for n in domain.shape) * scenario.recording.volume
    sizes = {
        "recording.rrd": BYTES_PER_PIXEL * shown * scenario.recording.rate * whole,
        "pictures.zarr": BYTES_PER_VALUE * shown * scenario.recording.rate * whole,
        "robots.parquet": sum(map(_bytes_per_tick, scenario.robots)) * scenario.duration / scenario.tick,
        "report.html": BYTES_OF_REPORT,
    }
    if scenario.probes is not None:
        sizes["probes.parquet"] = scenario.probes.bytes(scenario)
    if films is not None:
        # at the cells, and on their faces for a playback
        of_wind, of_gas = (2 * domain.dim + 1) * ("wind" in films.quantities), 2 * ("gas" in films.quantities)
        numbers = of_wind + of_gas * len(scenario.gases)
        frames = films.rate * (scenario.duration - films.start)
        sizes["fields.zarr"] = BYTES_PER_NUMBER * numbers * frames * prod(domain.shape)
    if log is not None:
        nodes = prod(extent / log.cell for extent in domain.extent[:2])
        sizes["plume.pslog"] = 3 * BYTES_PER_NUMBER * nodes * log.rate * (scenario.duration - log.start)
    return sizes


def _bytes_per_tick(group: Group) -> float:
    """Return the size [bytes] of the rows of a group's robots in robots.parquet, per tick."""
    further = group.sensors.ranges + len(group.sensors.noses) - 1
    return (BYTES_PER_ROW + BYTES_PER_NUMBER * further) * group.count * group.trials


def _others(scenario: Scenario) -> dict[str, float]:
    """Return the memory [bytes] of robots, algorithms and gases besides fields on the grid, by the section's path."""
    floor, tick = scenario.floor, scenario.tick
    sizes = {"robots": _robots(scenario) * float(BYTES_PER_ROBOT)}
    for n, group in enumerate(scenario.robots):
        sizes[f"robots[{n}].algorithm"] = group.algorithm.bytes(group, floor, tick)
    watched = enumerate(group.localization for group in scenario.robots)
    cameras = [(camera.frames, n) for n, camera in watched if isinstance(camera, Camera)]
    if cameras:  # whose frames hold the poses of all robots
        frames, n = max(cameras)
        sizes[f"robots[{n}].localization"] = BYTES_PER_POSE * _robots(scenario) * frames
    for path, gas in scenario.gases:
        sizes[path] = gas.bytes(scenario.domain.dim)
    return sizes


def _robots(scenario: Scenario) -> int:
    """Return the number of robots in all trials."""
    return sum(group.count * group.trials for group in scenario.robots)


def _of_solver(scenario: Scenario, cells: float, spacing: float) -> float:
    """Return the memory [bytes] of the pressure solver besides fast transforms and multigrid.

    Obstacles and partly open faces need a capacitance matrix or, if that is too large in 2-D, sparse factors.
    """
    domain, dim = scenario.domain, scenario.domain.dim
    if scenario.wind.computed is None or not cells:
        return 0.0
    surfaces = [obstacle.surface(domain) for obstacle in scenario.obstacles if obstacle.motion is None]
    regions = [opening.region for opening in scenario.openings if opening.lets_out]
    partial = [region for region in regions if region is not None and region.center is not None]
    surfaces += [region.area(domain.size, 1.0) for region in partial]
    if not surfaces:
        return 0.0
    beside = BESIDE * sum(surfaces) / spacing ** (dim - 1)
    if beside <= min(MOST_BESIDE, (ENTRIES_PER_CELL * cells) ** 0.5):
        return BYTES_PER_ENTRY * beside**2 + (BYTES_OF_CHANGES * cells if dim == 2 else 0.0)
    return BYTES_OF_FACTORS * cells if dim == 2 else 0.0


def too_large(scenario: Scenario) -> Iterator[str]:
    """Yield errors of a scenario that has too many or too few cells, or needs more memory than is free."""
    domain = scenario.domain
    cells = prod(max(1.0, extent / domain.spacing) for extent in domain.size)
    if grids := list(_grid_errors(scenario)):
        yield from grids
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
                    f"{most}: needs {memory(others[most])} of memory, {memory(free)} are free; use fewer robots "
                    "or trials"
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
    lasers = any(group.sensors.nose.kind == "tdlas" for group in scenario.robots)
    for n, gas_map in enumerate(scenario.maps):
        if (of_map := trials * gas_map.bytes(domain.size, readings, lasers)) > free:
            yield (
                f"maps[{n}]: needs {memory(of_map)} of memory for all trials, {memory(free)} are free; "
                "make its cells larger, or lower the trials"
            )
    yield from domain.rounded("domain")


def _grid_errors(scenario: Scenario) -> Iterator[str]:
    """Yield errors of search algorithms and gas maps whose own grids have too many or too few cells."""
    domain, floor = scenario.domain, scenario.floor
    lines = [gas_map.grid_error(f"maps[{n}]", domain.size) for n, gas_map in enumerate(scenario.maps)]
    if floor.fault(domain.extent) is None:
        teams = enumerate(scenario.robots)
        lines += [group.algorithm.grid_error(f"robots[{n}]", floor) for n, group in teams]
    yield from filter(None, lines)


def memory(amount: float) -> str:
    """Return a number of bytes as text, such as "1.2 GB"."""
    if amount < 9.95e8:
        return f"{max(amount / 1e6, 1.0):.2g} MB" if amount < 9.95e7 else f"{amount / 1e6:.0f} MB"
    return f"{amount / 1e9:,.0f} GB" if amount >= 1e11 else f"{amount / 1e9:.2g} GB"


def amounts(size: Mapping[str, float]) -> str:
    """Return memory, disk space and time of a run as text; size: result of `estimate`."""
    needed = round(size["bytes"] + PROGRAM_BYTES, -7)
    room = f"about {memory(needed)} of memory, {memory(size['disk'])} on the disk"
    return f"{room}, {_duration(size['wall_s'])} on a few CPU cores"


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.0f} h"


def derived(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield (name, text) for each derived quantity of a scenario: room, time, air, gas, robots, maps."""
    domain, size = scenario.domain, estimate(scenario)
    edges = " x ".join(with_unit(extent, "m") for extent in domain.extent)
    slab = "" if domain.dim == 3 else f", a layer of {with_unit(domain.depth, 'm')}"
    cells = " x ".join(map(str, domain.shape))
    yield "room", f"{edges}{slab}; {cells} = {size['cells']:,} cells of {with_unit(domain.spacing, 'm')}"
    whole = scenario.warm_up + scenario.duration
    ticks = scenario.last_tick - scenario.first_tick
    before = f" after a warm-up of {with_unit(scenario.warm_up, 's')}" if scenario.warm_up else ""
    yield (
        "time",
        f"{with_unit(scenario.duration, 's')}{before}: {ticks:,} ticks of {with_unit(scenario.tick, 's')}, about "
        f"{size['steps']:,} steps of the flow of {_about(size['step'], 's')}",
    )
    yield from _air(scenario, whole)
    yield from _gas(scenario)
    if scenario.robots:
        robots = [
            f"{group.name}: {group.count} {group.algorithm.kind}"
            + f" x {group.trials} trials" * (group.trials > 1)
            for group in scenario.robots
        ]
        yield "robots", "; ".join(robots)
    if scenario.maps:
        sizes = [" x ".join(map(str, gas_map.cells(domain.extent))) for gas_map in scenario.maps]
        maps = zip(scenario.maps, sizes, strict=True)
        yield "maps", "; ".join(f"{gas_map.kind} {cells} cells" for gas_map, cells in maps)


def _air(scenario: Scenario, whole: float) -> Iterator[tuple[str, str]]:
    """Yield (name, text) on air changes in `whole` seconds, and on Reynolds numbers of room, jets and a cell."""
    domain, speed = scenario.domain, scenario.wind.top_speed(scenario)
    inflow = _inflow(scenario)
    if inflow > 0:
        volume = _volume(scenario)
        yield (
            "air",
            f"{_about(inflow, 'm^3/s')} flows in at the start: one air change every "
            f"{_about(volume / inflow, 's')}, {whole * inflow / volume:.3g} in the run",
        )
    if not speed:
        return
    nu = scenario.wind.computed.viscosity if scenario.wind.computed else AIR_VISCOSITY
    jets = [
        (
            f"wind.openings[{n}]",
            opening.top_speed(domain) * 2 * min(opening.region.rectangle(domain.extent)[1]),
        )
        for n, opening in enumerate(scenario.openings)
        if opening.blows and opening.region is not None and opening.region.center is not None
    ]
    numbers = [("the room", speed * min(domain.extent)), *jets[:2], ("a cell", speed * domain.spacing)]
    if nu:
        shown = ", ".join(f"{_rounded(value / nu)} of {name}" for name, value in numbers if value)
        yield "Reynolds", f"at the highest speed expected, {_about(speed, 'm/s')}: {shown}"


def _gas(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield (name, text) on the emission rate of each gas, and its concentration in well-mixed air."""
    inflow, texts = _inflow(scenario), []
    for _, gas in scenario.gases:
        rates = [vars(source).get("rate") for source in gas.sources]
        rate = sum(rate for rate in rates if rate)
        text = f"{gas.vapour.name}, {len(rates)} source{'s' * (len(rates) != 1)}"
        if rate:
            text += f", {_about(rate, 'kg/s')} while on"
            if inflow > 0:
                text += f": {rate / inflow * gas.vapour.ppm_per_density:.2g} ppm if all air is well mixed"
        if background := scenario.backgrounds[gas.vapour.name]:
            text += f"; above a background of {background:g} ppm"
        texts.append(text)
    if len(texts) > 1 and len(set(texts)) == 1:
        yield "gas", f"{len(texts)} parts, each {texts[0]}"
    else:
        yield from zip((path for path, _ in scenario.gases), texts, strict=True)


def _inflow(scenario: Scenario) -> float:
    """Return the total flow rate of openings that blow air into the room at t = 0 [m³/s]."""
    openings = [opening for opening in scenario.openings if not opening.follows_pressure]
    return sum(max(0.0, opening.inflow(0.0, scenario.domain)) for opening in openings)


def _volume(scenario: Scenario) -> float:
    """Return the volume of the room [m³], obstacles included."""
    return prod(scenario.domain.extent, start=1.0 if scenario.domain.dim == 3 else scenario.domain.depth)


def _rounded(value: float) -> str:
    """Return a number as text with two significant digits."""
    value = float(f"{value:.2g}")
    return f"{value:,.0f}" if value >= 10 else f"{value:g}"


def _about(value: float, unit: str) -> str:
    """Return a value in `unit`, rounded to three digits, as text with a handy unit."""
    return with_unit(float(f"{value:.3g}"), unit)
