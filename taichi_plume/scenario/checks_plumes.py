"""What is wrong with gusts and with the gases that need a uniform wind: lines as of `checks`."""

from collections.abc import Iterator

import numpy as np

from taichi_plume.scenario.closed_forms import (
    ClosedForm,
    ContinuousGas,
    GaussianPlumeGas,
    GaussianPuffGas,
    MeanderingGas,
)
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.winds import UniformWind

MOST_KNOTS = 1_000_000  # of the gusts; they are drawn at the start
PARALLEL = 1e-9  # share of the wind through a wall that is none


def plume_problems(scenario: Scenario) -> Iterator[str]:
    """Faults of the gusts and of every closed form."""
    wind = scenario.wind
    if isinstance(wind, UniformWind):
        yield from _gusts(scenario, wind)
    for path, gas in scenario.gases:
        if not isinstance(gas, ClosedForm):
            continue
        if isinstance(wind, UniformWind):
            yield from _form(path, gas, scenario, wind)
        else:
            yield (
                f"{path}.kind: {gas.kind} takes a uniform wind, but wind.kind is {wind.kind}; use wind.kind: uniform, "
                f"or {path}.kind: eulerian"
            )


def _gusts(scenario: Scenario, wind: UniformWind) -> Iterator[str]:
    gusts, dim = wind.gusts, scenario.domain.dim
    if gusts is None:
        return
    if not wind.speed:
        yield "wind.gusts: are a share of the wind's speed, which is 0; give wind.velocity or remove the gusts"
        return
    if dim == 2 and gusts.vertical:
        yield "wind.gusts.vertical: a 2-D run has no vertical; remove it, or give domain.size three numbers"
    crossing = float(np.abs(wind.frame[0]) @ scenario.domain.extent) / wind.speed
    if crossing > gusts.time * MOST_KNOTS / 20:
        yield (
            f"wind.gusts.time: {gusts.time:g} s is too short for air that takes {crossing:.3g} s through the domain; "
            f"use {20 * crossing / MOST_KNOTS:.2g} s or more, or a faster wind"
        )


def _form(path: str, gas: ClosedForm, scenario: Scenario, wind: UniformWind) -> Iterator[str]:
    dim = scenario.domain.dim
    needs_wind = isinstance(gas, GaussianPlumeGas | MeanderingGas)
    if needs_wind and not wind.speed:
        yield f"wind.velocity: is 0, but {path}.kind: {gas.kind} is a plume; give it a speed"
        return
    if isinstance(gas, MeanderingGas) and wind.gusts is None:
        yield f"wind.gusts: are missing, and {path}.kind: meandering follows them; add gusts: {{intensity: 0.15}}"
    if wind.gusts is not None and isinstance(gas, ContinuousGas):
        yield (
            f"{path}.kind: continuous has no solution in a gusty wind; remove wind.gusts, or use kind: meandering or "
            "gaussian_puff"
        )
    if wind.gusts is not None and isinstance(gas, GaussianPlumeGas):
        yield (
            f"{path}.kind: gaussian_plume is a mean over gusts, which the robots would feel without any effect on the "
            "gas; remove wind.gusts, or use kind: meandering"
        )
    yield from _walls(path, gas, scenario, wind)
    if isinstance(gas, GaussianPuffGas | ContinuousGas):
        yield from _numbers(f"{path}.diffusivity", gas.diffusivity, dim, "")
    if isinstance(gas, GaussianPlumeGas):
        yield from _numbers(f"{path}.intensity", gas.intensity, dim - 1, " across the wind")
        yield from _numbers(f"{path}.diffusivity", gas.diffusivity, dim - 1, " across the wind")
    if isinstance(gas, ContinuousGas):
        if gas.diffusivity is not None and not all(gas.diffusivity):
            yield f"{path}.diffusivity: must be above 0, or the plume is infinitely thin; or use kind: gaussian_plume"
        for n, source in enumerate(gas.sources):
            if source.start is None and not wind.speed:
                yield (
                    f"{path}.sources[{n}].start: is missing: in still air, gas that has been emitted for ever is "
                    f"everywhere; give it, such as {-scenario.warm_up:g} s"
                )
    if isinstance(gas, GaussianPuffGas) and wind.gusts is not None:
        begin = scenario.first_tick * scenario.tick
        for n, release in enumerate(gas.releases):
            if release.time < begin:
                yield (
                    f"{path}.releases[{n}].time: {release.time:g} s is before the gusts begin, at {begin:g} s; release "
                    "it later or raise warm_up"
                )


def _numbers(path: str, given: tuple[float, ...] | None, most: int, where: str) -> Iterator[str]:
    if given is not None and len(given) not in (1, most):
        each = f", or one for each of the {most} axes{where}" if most > 1 else ""
        yield f"{path}: has {len(given)} numbers; give one{each}"


def _walls(path: str, gas: ClosedForm, scenario: Scenario, wind: UniformWind) -> Iterator[str]:
    """Reflection is right where air moves along a wall; the plume's centre alone may be swept to and fro."""
    dim = scenario.domain.dim
    for face in gas.reflecting(dim):
        d = "xyz".index(face[0])
        default = " (z- is one unless walls says otherwise)" if gas.walls is None else ""
        if d >= dim:
            yield f"{path}.walls: '{face}' does not exist in a 2-D run; use x-, x+, y- or y+"
        elif abs(wind.velocity[d]) > PARALLEL * wind.speed:
            yield (
                f"{path}.walls: the wind blows through {face}{default}, with {wind.velocity[d]:g} m/s along "
                f"{face[0]}; take {face} out of walls or turn the wind"
            )
        elif wind.gusts is not None and isinstance(gas, GaussianPuffGas):
            deviations = np.array(wind.gusts.deviations(dim)) @ np.abs(wind.frame[1:])
            if deviations[d] > PARALLEL:
                yield (
                    f"{path}.walls: gusts blow through {face}{default}, across the wind; take {face} out of walls, or "
                    "calm that part of wind.gusts"
                )
