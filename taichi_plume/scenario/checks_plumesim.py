"""What is wrong with plumes of PlumeSim: files of points that are damaged or elsewhere, and what a log cannot hold."""

from collections.abc import Iterator
from math import prod
from pathlib import Path

import numpy as np

from taichi_plume.files.point_frames import PointFileError, PointFrames, frames_of
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.plumesim import FluentGas, PlumeSimGas, PlumeSimMeander, PlumeSimPuff
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.winds import PlumeSimWind, PointPlayback

MOST_NODES = 1_000_000  # of a log
CLOSE = 1e-6  # of a number: as good as whole


def point_plumes(scenario: Scenario, folder: Path) -> Iterator[str]:
    """Plumes and winds of points; `folder` is where their files lie."""
    extent = scenario.domain.extent
    for path, model in (("wind", scenario.wind), *scenario.gases):
        if isinstance(model, PlumeSimWind | PlumeSimGas | FluentGas):
            key = "files" if isinstance(model, FluentGas) else "file"
            try:
                frames = frames_of(model, folder)
            except PointFileError as error:
                yield f"{path}.{key}: {error}"
                continue
            yield from _playable(path, model, frames, extent)
        elif isinstance(model, PlumeSimPuff | PlumeSimMeander):
            x, y = model.release_point
            if not (0 <= x <= extent[0] and 0 <= y <= extent[1]):
                yield (
                    f"{path}.release_point: ({x:g}, {y:g}) m is outside the domain, {_box(extent)}; move the release in"
                )
            elif isinstance(model, PlumeSimMeander) and x + model.radius > extent[0]:
                yield (
                    f"{path}.release_point: x = {x:g} m is at the domain's end, {extent[0]:g} m, and the plume goes on "
                    "from there; move it back"
                )
        if isinstance(model, PlumeSimPuff):
            yield from _nodes(path, model.cell, extent)
    if isinstance(scenario.wind, PlumeSimWind):
        yield from _needs_flow(scenario)


def _playable(
    path: str, model: PointPlayback, frames: PointFrames, extent: tuple[float, ...]
) -> Iterator[str]:
    """Some of the points are in the domain, and there is something to show at the start."""
    place = frames.place + np.array(model.offset)
    low, high = place.min(axis=0), place.max(axis=0)
    if not ((place > -frames.cell) & (place < np.array(extent[:2]) + frames.cell)).all(axis=1).any():
        yield (
            f"{path}: no point of {frames.path} is in the domain, {_box(extent)}; they are within x {low[0]:.4g} to "
            f"{high[0]:.4g} m, y {low[1]:.4g} to {high[1]:.4g} m; give an offset"
        )
    end = len(frames) * frames.period
    if model.start >= end and not model.loop and len(frames) > 1:
        yield f"{path}.start: {model.start:g} s is after the last frame of {frames.path}, which ends at {end:g} s"


def _needs_flow(scenario: Scenario) -> Iterator[str]:
    """What a wind that is known at points only cannot do."""
    for path, gas in scenario.gases:
        if isinstance(gas, EulerianGas):
            yield (
                f"{path}.kind: a wind of kind plumesim_log is known at points and cannot carry an eulerian gas; play "
                "the log's plume, or use another wind"
            )
    if scenario.fields is not None and "wind" in scenario.fields.quantities:
        yield (
            "fields.quantities: a wind of kind plumesim_log has no velocities on the grid; use quantities: [gas]"
        )
    for n, group in enumerate(scenario.robots):
        if group.wake:
            yield (
                f"robots[{n}].wake: a wind of kind plumesim_log is not disturbed; use another, or remove the wake"
            )


def plume_logs(scenario: Scenario) -> Iterator[str]:
    """The log that a run is to write."""
    model, domain = scenario.plumesim_log, scenario.domain
    if model is None:
        return
    ticks = 1 / (model.rate * scenario.tick)
    whole = max(1, round(ticks))
    if abs(ticks - whole) > CLOSE * whole or abs(1000 * scenario.tick * whole % 1 - 0.5) < 0.5 - CLOSE:
        yield (
            f"plumesim_log.rate: {model.rate:g} frames per second are {1000 / model.rate:g} ms each, which must be "
            f"whole milliseconds and whole ticks of {1000 * scenario.tick:g} ms; use "
            f"{1 / (whole * scenario.tick):.6g}, or change tick"
        )
    if model.start > scenario.duration:
        yield f"plumesim_log.start: {model.start:g} s is after the end at {scenario.duration:g} s; start it earlier"
    yield from _nodes("plumesim_log", model.cell, domain.extent)
    if domain.dim == 3 and model.height > domain.extent[2]:
        yield (
            f"plumesim_log.height: {model.height:g} m is above the ceiling; use at most {domain.extent[2]:g} m"
        )


def _nodes(path: str, cell: float, extent: tuple[float, ...]) -> Iterator[str]:
    """Nodes on the domain: some, and not too many."""
    nodes = prod(width / cell for width in extent[:2])
    if nodes > MOST_NODES:
        yield f"{path}.cell: {cell:g} m makes {nodes:.3g} nodes, at most {MOST_NODES} are allowed; raise it"
    if cell > min(extent[:2]):
        yield f"{path}.cell: {cell:g} m is wider than the domain, {_box(extent)}; lower it"


def _box(extent: tuple[float, ...]) -> str:
    return f"x 0 to {extent[0]:.4g} m, y 0 to {extent[1]:.4g} m"
