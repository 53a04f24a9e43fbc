"""Checks of sections against the files that they name: their grids, times, extents and recorded robots.

A section checks its own keys (`errors`, `warnings`); what depends on the content of its file is checked here.
"""

from collections.abc import Callable, Iterator
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import psutil

from taichi_plume.assembly.resources import Resources
from taichi_plume.scenario import checks
from taichi_plume.scenario.domain import span
from taichi_plume.scenario.external import Replay
from taichi_plume.scenario.gases import PlaybackGas
from taichi_plume.scenario.imported_wind import ImportedWind
from taichi_plume.scenario.initial_conditions import FilmedInitial, InitialGas, InitialWind
from taichi_plume.scenario.playback import (
    GadenGas,
    MovieGas,
    Playback,
    PlaybackWind,
    Played,
    PlumeSimWind,
    PointPlayback,
)
from taichi_plume.scenario.plumesim import FluentGas, PlumeSimGas
from taichi_plume.scenario.robots import Group

if TYPE_CHECKING:  # they bring Taichi and readers of bags, for scenarios that need them
    from taichi_plume.files.gaden import Cubes
    from taichi_plume.files.wind_site import Site

ROUNDED = 1e-6  # of a time: rounding of times in files
ROUNDING = 0.01  # cells by which the domain may exceed the points of an imported wind
MOST_LISTED = 10  # names of recorded robots in a message


def errors(resources: Resources) -> list[str]:
    """Return the errors of a scenario whose input files have been opened, each as a line ``path: message``.

    If files could not be read or do not fit, only these errors are returned: the other checks need all files.
    """
    if resources.faults:
        return [f"{path}: {fault}" for path, fault in resources.faults.items()]
    found = (check(resources, where, section) for where, section, check in _checked(resources, ERRORS))
    return [line for lines in found for line in lines] or checks.errors(resources.context)


def warnings(resources: Resources) -> list[str]:
    """Return the warnings of a scenario without errors, each as a line ``path: message``."""
    lines = [f"{where}: {remark}" for where, facts in resources.facts.items() for remark in facts.remarks]
    for where, section, check in _checked(resources, WARNINGS):
        lines += check(resources, where, section)
    return lines + checks.warnings(resources.context)


def _checked(resources: Resources, table: "Table") -> "Iterator[tuple[str, Any, Check]]":
    for where, section in checks.every(resources.scenario):
        if type(section) in table:
            yield where, section, table[type(section)]


def _ends_early(resources: Resources, where: str, file: str | Path, end: float, then: str) -> Iterator[str]:
    """Yield a warning if the data of a file, whose key is `where`, end at time `end` [s], before the run does.

    then: what the run does from this time on.
    """
    until = resources.scenario.duration
    if end < until - ROUNDED * max(1.0, abs(until)):
        yield f"{where}: the data of {Path(file).name} end at {end:.4g} s, the run at {until:g} s; {then}"


# ---------------------------------------------------------------- playback


def _recorded(resources: Resources, where: str) -> tuple[str | Path, int, float]:
    """Return the file of a played section's frames, their number, and the time [s] of the frames at which they end."""
    for films in (resources.films, resources.movies, resources.gaden_films):
        if (film := films.get(where)) is not None:
            return film.path, len(film.times), float(film.times[-1])
    if (frames := resources.frames.get(where)) is not None:
        return frames.path, len(frames), len(frames) * frames.period
    last, path = _site(resources).files[-1]
    return path, len(_site(resources).files), last


def _site(resources: Resources) -> "Site":
    assert resources.site is not None
    return resources.site


def _too_late(resources: Resources, where: str, played: Played) -> Iterator[str]:
    """Yield an error if playback without loop starts after the end of the frames. One frame is a steady state."""
    file, count, last = _recorded(resources, where)
    late = played.start > last or (played.start == last and played.steps)
    if late and count > 1 and not played.loop:
        yield f"{where}.start: {played.start:g} s is after the end of {file} at {last:g} s"


def _played(resources: Resources, where: str, played: Played) -> Iterator[str]:
    """Yield a warning if playback without loop ends before the run."""
    file, count, last = _recorded(resources, where)
    if count > 1 and not played.loop:
        then, end = (
            f"the last frame holds; {where}.loop: true repeats them",
            (last - played.start) / played.rate,
        )
        yield from _ends_early(resources, f"{where}.{played.key}", file, end, then)


def _playback(resources: Resources, where: str, playback: Playback) -> Iterator[str]:
    film, part = resources.films[where], playback.part
    recorded = [name for name, variables in (("wind", film.wind), ("gas", film.gas)) if variables]
    if part not in recorded:
        yield (
            f"{where}.file: {film.path}: holds no {part}, only {', '.join(recorded) or 'nothing'}; record "
            f"with fields.quantities: [{part}]"
        )
    elif another := list(_another_domain(resources, where, playback)):
        yield from another
    elif differing := resources.unlike(where):
        yield (
            f"obstacles: {differing} cells are not as in {film.path}, which {part} plays back; "
            "give the obstacles of the recorded run"
        )
    yield from _too_late(resources, where, playback)


def _another_domain(resources: Resources, where: str, playback: Playback) -> Iterator[str]:
    """Yield an error if the grid of the recorded run differs from that of the scenario."""
    film, domain = resources.films[where], resources.scenario.domain
    if domain.shape != film.shape or abs(domain.spacing - film.dx) > 1e-6 * film.dx:
        size = ", ".join(f"{n * film.dx:.6g}" for n in film.shape)
        yield (
            f"domain: {_cells(domain.shape, domain.spacing)}, but {film.path}, which {playback.part} plays back, has "
            f"{_cells(film.shape, film.dx)}; use size: [{size}], spacing: {film.dx:g}"
        )
    elif playback.part == "gas" and domain.dim == 2 and abs(domain.depth - film.depth) > 1e-6 * film.depth:
        yield (
            f"domain.depth: {domain.depth:g} m, but the gas of {film.path} was recorded in {film.depth:g} m; "
            f"use depth: {film.depth:g}"
        )


def _cells(shape: tuple[int, ...], dx: float) -> str:
    """Return the size of a grid in words, such as "80 x 60 cells of 0.05 m"."""
    return f"{' x '.join(map(str, shape))} cells of {dx:g} m"


def _points(resources: Resources, where: str, playback: PointPlayback) -> Iterator[str]:
    frames, domain = resources.frames[where], resources.scenario.domain
    place = frames.place + np.array(playback.offset)
    low, high = place.min(axis=0), place.max(axis=0)
    if not ((place > -frames.cell) & (place < np.array(domain.extent[:2]) + frames.cell)).all(axis=1).any():
        yield (
            f"{where}: no point of {frames.path} is in the domain, {domain.box}; they are within "
            f"{span('x', low[0], high[0])}, {span('y', low[1], high[1])}; give an offset"
        )
    yield from _too_late(resources, where, playback)


def _movie(resources: Resources, where: str, gas: MovieGas) -> Iterator[str]:
    movie, domain = resources.movies[where], resources.scenario.domain
    (x, y), (width, height) = movie.origin, movie.size
    if not (x < domain.extent[0] and y < domain.extent[1] and x + width > 0 and y + height > 0):
        yield (
            f"{where}: no pixel of {movie.path} is in the domain, {domain.box}; they are within "
            f"{span('x', x, x + width)}, {span('y', y, y + height)}; give an origin"
        )
    yield from _too_late(resources, where, gas)


def _gaden(resources: Resources, where: str, gas: GadenGas) -> Iterator[str]:
    film, domain = resources.gaden_films[where], resources.scenario.domain
    low, high = film.first.low[: domain.dim] - film.origin, film.high[: domain.dim] - film.origin
    if not ((low < domain.extent) & (high > 0.0)).all():
        spans = ", ".join(span(x, a, b) for x, a, b in zip("xyz", low, high, strict=False))
        yield (
            f"{where}: no cell of {film.path} is in the domain, {domain.box}; they are within {spans}; "
            "give an origin"
        )
    yield from _too_late(resources, where, gas)


def _filmed(resources: Resources, where: str, initial: FilmedInitial) -> Iterator[str]:
    if initial.film is None:
        return
    film, domain = resources.films[where], resources.scenario.domain
    if not (film.wind if initial.part == "wind" else film.gas):
        yield (
            f"{where}.film: {film.path}: holds no {initial.part}; record it with "
            f"fields.quantities: [{initial.part}]"
        )
    size = [n * film.dx for n in film.shape]
    beyond = len(size) != domain.dim or any(
        need > has + 0.5 * film.dx for need, has in zip(domain.extent, size, strict=True)
    )
    if beyond:
        shown = " x ".join(f"{length:.6g}" for length in size)
        yield (
            f"{where}.film: {film.path}: shows {shown} m, the domain is "
            f"{' x '.join(f'{length:.6g}' for length in domain.extent)} m; record all of it"
        )
    first, last = film.times[0], film.times[-1]
    if initial.at is not None and not first <= initial.at <= last:
        yield f"{where}.at: {initial.at:g} s is not in {film.path}, which shows {first:g} to {last:g} s"


# ---------------------------------------------------------------- imported wind


def _imported(resources: Resources, where: str, wind: ImportedWind) -> Iterator[str]:
    """Yield errors found in the first and last wind file; the other files are read at the start of the run."""
    site, domain = _site(resources), resources.scenario.domain
    yield from _looped(site, where, wind)
    low, high = site.levels
    if wind.height is not None and not low <= wind.height <= high:
        yield f"{where}.height: {wind.height:g} m is outside of {site.first.path}, z {low:g} to {high:g} m"
        return
    yield from _too_late(resources, where, wind)
    needed = 4.0 * len(site.files) * prod(n + 2 for n in domain.shape) * (domain.dim + 1)
    free = psutil.virtual_memory().available
    if needed > free:
        yield (
            f"{where}.files: {len(site.files)} files on this grid need {needed / 1e9:.2g} GB of memory, "
            f"{free / 1e9:.2g} GB are free; use fewer, or raise domain.spacing"
        )
    beyond = list(_beyond_cubes(resources, wind))
    yield from beyond
    if not beyond:
        yield from _without_wind(resources, wind)
        if site.cubes is not None:
            yield from _in_cubes(resources, site.cubes, wind)


def _looped(site: "Site", where: str, wind: ImportedWind) -> Iterator[str]:
    """Yield errors of `loop_from` and `loop_to`, which name times of files."""
    times = [time for time, _ in site.files]
    for key, time in (("loop_from", wind.loop_from), ("loop_to", wind.loop_to)):
        if time is None:
            continue
        if not wind.loop:
            yield f"{where}.{key}: repeats nothing without loop: true"
        elif not times[0] <= time <= times[-1]:
            yield f"{where}.{key}: {time:g} s is outside of the files, {times[0]:g} to {times[-1]:g} s"
    first, last = wind.looped
    if not any(first <= time <= last for time in times):
        yield f"{where}.loop_from: no file is from {first:g} s to loop_to, {last:g} s"


def _beyond_cubes(resources: Resources, wind: ImportedWind) -> Iterator[str]:
    """Yield an error for each axis along which the domain reaches beyond GADEN's occupancy grid."""
    site, domain = _site(resources), resources.scenario.domain
    if site.cubes is None:
        return
    slack = ROUNDING * domain.spacing
    for a, extent in enumerate(domain.extent):
        low, high = site.cubes.low[a], site.cubes.high[a]
        if low > slack or extent > high + slack:
            yield _outside(site, a, (0.0, extent), (low, high), f"{wind.occupancy} has cells")


def _without_wind(resources: Resources, wind: ImportedWind) -> Iterator[str]:
    """Yield an error for each axis along which grid cells with air lie beyond the points of the wind file."""
    site, domain = _site(resources), resources.scenario.domain
    cells = np.argwhere(~resources.solid())
    if not len(cells):
        yield f"wind.occupancy: {wind.occupancy}: leaves no air in the domain"
        return
    dx = domain.spacing
    slack = ROUNDING * dx + site.slack
    for a in range(domain.dim):
        low, high = cells[:, a].min() * dx, (cells[:, a].max() + 1) * dx
        if low < site.low[a] - slack or high > site.high[a] + slack:
            yield _outside(site, a, (low, high), (site.low[a], site.high[a]), f"{site.first.path} has points")


def _in_cubes(resources: Resources, cubes: "Cubes", wind: ImportedWind) -> Iterator[str]:
    """Yield errors of a raised floor, and of sources and robots inside obstacles, in GADEN's occupancy grid."""
    file, scenario = wind.occupancy, resources.scenario
    if scenario.robots and scenario.domain.dim == 3:
        floor = int((~cubes.solid).any(axis=(0, 1)).argmax())  # the lowest layer with air
        low = cubes.low[2] + floor * cubes.size
        if low > ROUNDING * scenario.domain.spacing:
            yield (
                f"wind.origin: the floor of {file} is {low:.4g} m above the floor of the domain; use "
                f"{low + _site(resources).origin[2]:.6g} as third number"
            )
            return
    for path, source in scenario.sources:
        place = np.array([source.position])
        if place.shape[1] == scenario.domain.dim and cubes.inside(place)[0]:
            yield f"{path}.position: is inside an obstacle of {file}; move the source"
        elif (motion := vars(source).get("motion")) is not None:
            times, way = motion.samples(source.position, 0.25 * cubes.size)
            for n in np.flatnonzero(cubes.inside(way))[:1]:
                at = f"at {times[n]:.4g} s ({', '.join(f'{x:.4g}' for x in way[n])}) m"
                yield f"{path}.motion.path: {at} is inside an obstacle of {file}; lead the path around it"
    for n, group in enumerate(scenario.robots):
        places = group.places(scenario.floor)
        if places is not None:
            away = cubes.horizontal_distance(places, 0.0, group.body.height)
            each = ".positions[{}]:" if len(group.start.listed) else ": robot {}"
            for k in np.flatnonzero(away < group.body.radius):
                yield f"robots[{n}].start{each.format(k)} touches an obstacle of {file}; move the robot"


def _outside(site: "Site", axis: int, air: tuple[float, float], known: tuple[float, float], have: str) -> str:
    """Return an error: along an axis the range `air` [m] of the domain reaches beyond the range `known` of a file."""
    x, origin = "xyz"[axis], site.origin[axis]
    (a, b), (low, high) = air, known
    places = [f"{round(origin + place, 6) + 0.0:g}" for place in (a, b, low, high)]
    return (
        f"domain.size[{axis}]: the domain's air is at {x} = {places[0]} to {places[1]} m of the files, but {have} only "
        f"at {places[2]} to {places[3]} m; use at most {high - low:.6g} m, and {places[2]} as number {axis + 1} of "
        "wind.origin, written into the scenario's file (positions of sources, robots and obstacles count from there)"
    )


# ---------------------------------------------------------------- recorded robots


def _group(resources: Resources, where: str) -> Group:
    """Return the group of robots whose algorithm has the path `where`, such as ``robots[0].algorithm``."""
    return next(
        group for n, group in enumerate(resources.scenario.robots) if where == f"robots[{n}].algorithm"
    )


def _replay(resources: Resources, where: str, replay: Replay) -> Iterator[str]:
    names = [path.name for path in resources.ways[where]]
    count = _group(resources, where).count
    listed = ", ".join(names[:MOST_LISTED]) + (" ..." if len(names) > MOST_LISTED else "")
    missing = [name for name in replay.robots if name not in names]
    if missing:
        yield f"{where}.robots: there is no '{missing[0]}' in {replay.file}; it has {listed}"
    elif len(names) < count:
        yield f"{where}.file: {replay.file} has {len(names)} robots, {listed}; the team has {count}"
    else:
        for name, position, inside in _positions(resources, where, replay):
            if not inside.any():
                low, high = position.min(axis=0), position.max(axis=0)
                yield (
                    f"{where}.origin: {name} is never in the domain, {resources.scenario.domain.box}; it is within "
                    f"{span('x', low[0], high[0])}, {span('y', low[1], high[1])}"
                )


def _replayed(resources: Resources, where: str, replay: Replay) -> Iterator[str]:
    from taichi_plume.files.trajectories import begin_of, chosen

    for name, _, inside in _positions(resources, where, replay):
        if not inside.all():
            share = 100 * (1.0 - inside.mean())
            yield f"{where}.file: {name} is not in the domain for {share:.0f} % of its poses"
    paths = chosen(replay, resources.ways[where], _group(resources, where).count)
    unplaced = {path.frame for path in paths} - {None, "map", "domain"}
    if unplaced and replay.origin is None:
        names = " and ".join(sorted(map(str, unplaced)))
        yield (
            f"{where}.origin: the positions are in frame {names}, whose origin is assumed at the domain's lower "
            "corner; give its position in the domain"
        )
    first = min(paths, key=lambda path: path.t[-1])
    name, end = f"{first.name} in {replay.file}", float(first.t[-1]) - begin_of(replay, paths)
    yield from _ends_early(resources, f"{where}.file", name, end, "the robot stands at its last pose")


def _positions(
    resources: Resources, where: str, replay: Replay
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield for each robot: name, recorded positions (n, 2) [m], and whether each is inside the domain (n,)."""
    from taichi_plume.files.trajectories import chosen

    size = np.array(resources.scenario.domain.extent[:2])
    for path in chosen(replay, resources.recorded_paths(where), _group(resources, where).count):
        position = path.place[:, :2]
        yield path.name, position, np.asarray(((position > 0.0) & (position < size)).all(axis=1))


Check = Callable[[Resources, str, Any], Iterator[str]]
Table = dict[type, Check]
ERRORS: Table = {
    PlaybackWind: _playback,
    PlaybackGas: _playback,
    PlumeSimWind: _points,
    PlumeSimGas: _points,
    FluentGas: _points,
    MovieGas: _movie,
    GadenGas: _gaden,
    InitialWind: _filmed,
    InitialGas: _filmed,
    ImportedWind: _imported,
    Replay: _replay,
}
"""Checks of the content of files, which make the other checks impossible."""
PLAYED = (PlaybackWind, PlaybackGas, PlumeSimWind, PlumeSimGas, FluentGas, MovieGas, GadenGas, ImportedWind)
WARNINGS: Table = {Replay: _replayed, **dict.fromkeys(PLAYED, _played)}
