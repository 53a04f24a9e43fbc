"""Quantities that follow from a scenario: grid, time steps, air changes, Reynolds numbers, mean concentration."""

from collections.abc import Iterator
from math import ceil

from taichi_plume.scenario.quantities import with_unit
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.size import estimate
from taichi_plume.scenario.species import AIR_VISCOSITY


def derived(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Lines about a scenario, each with its name."""
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
        width, length = domain.extent[:2]
        maps = [
            f"{one.kind} {ceil(width / one.cell - 1e-9)} x {ceil(length / one.cell - 1e-9)} cells"
            for one in scenario.maps
        ]
        yield "maps", "; ".join(maps)


def _air(scenario: Scenario, whole: float) -> Iterator[tuple[str, str]]:
    """Air that comes in, and Reynolds numbers of the room, of jets and of a cell."""
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
    """Rate of each gas, and its concentration if all air of the room were mixed."""
    inflow, texts = _inflow(scenario), []
    for _, gas in scenario.gases:
        rates = [getattr(source, "rate", None) for source in gas.sources]
        rate = sum(one for one in rates if one)
        text = f"{gas.vapour.name}, {len(rates)} source{'s' * (len(rates) != 1)}"
        if rate:
            text += f", {_about(rate, 'kg/s')} while on"
            if inflow > 0:
                text += f": {rate / inflow * gas.vapour.ppm_per_density:.2g} ppm if all air is well mixed"
        texts.append(text)
    if len(texts) > 1 and len(set(texts)) == 1:
        yield "gas", f"{len(texts)} parts, each {texts[0]}"
    else:
        yield from zip((path for path, _ in scenario.gases), texts, strict=True)


def _inflow(scenario: Scenario) -> float:
    """Air that openings blow in at the start [m³/s]."""
    rates = [one.inflow(0.0, scenario.domain) for one in scenario.openings if not one.follows_pressure]
    return sum(rate for rate in rates if rate > 0)


def _volume(scenario: Scenario) -> float:
    """Volume of the room, obstacles included [m³]."""
    volume = 1.0 if scenario.domain.dim == 3 else scenario.domain.depth
    for extent in scenario.domain.extent:
        volume *= extent
    return volume


def _rounded(value: float) -> str:
    """A number to two digits."""
    value = float(f"{value:.2g}")
    return f"{value:,.0f}" if value >= 10 else f"{value:g}"


def _about(value: float, unit: str) -> str:
    return with_unit(float(f"{value:.3g}"), unit)
