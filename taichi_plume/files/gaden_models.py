"""GADEN's preprocessing (voxelisation): from STL models to the occupancy grid, without an OccupancyGrid3D.csv.

As in GADEN, a voxel that a triangle of a model intersects is an obstacle, and of an outlet model an outlet; the air is
the flood fill from `empty_point`. So models need not be closed, and the inside of a wall or table is no air. A face
between two voxels counts for the voxel inside of its body, whichever way the normal points, and of open sheets for the
upper voxel. A closed body around `empty_point` is the hull of the air. The models are listed in

    environment_configurations/CONFIG/config.yaml     GADEN 3: names relative to this file
    params/preproc_params.yaml                        GADEN 2: names begin with package variables of ROS
    simulations/SIM.yaml                              GADEN 2, where it lists models for variables of that file
"""

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from taichi_plume.files.gaden import Occupancy
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.grid.mesh_files import MeshError, read_mesh
from taichi_plume.guard.safe_open import moved
from taichi_plume.scenario.loading import ScenarioError, read_mapping

OLD = "preproc_params.yaml"
NEEDS = "a configuration lists its models"
SIMULATIONS = "simulations"
VARIABLE = re.compile(r"\$\(var\s+(\w+)\)")
PACKAGE = re.compile(r"package://[^/]*/|.*\)[^/]*/")  # the start of a path that ROS resolves
MOST_VOXELS = 50_000_000
CHUNK = 1 << 19  # pairs tested together
TOUCH = 1e-4  # voxels: tolerance of faces
SAME = 1e-5  # voxels: tolerance of corners
UNKNOWN, OBSTACLE, OUTLET, AIR = -1, 1, 2, 0


def configuration(path: Path) -> dict[str, Any]:
    """Return the content of GADEN's config.yaml (GADEN 3) or preproc_params.yaml (GADEN 2). Raises ScenarioError.

    path: also a simulation of GADEN 2, whose values take the places of variables in the preproc_params.yaml beside.
    """
    if not _is_simulation(path):
        data = read_mapping(path, NEEDS)
        return parameters(path, data, "gaden_preprocessing") if path.name == OLD else data
    values, listing = read_mapping(path, NEEDS), path.parent.parent / "params" / OLD
    found = parameters(listing, read_mapping(listing, NEEDS), "gaden_preprocessing")
    return {key: substituted(value, values) for key, value in found.items()}


def _is_simulation(path: Path) -> bool:
    return path.parent.name == SIMULATIONS and path.name not in (OLD, "sim.yaml")


def parameters(path: Path, data: Mapping[str, Any], node: str, needs: str = NEEDS) -> dict[str, Any]:
    """Return the parameters of a ROS node in a parameter file, over those of all nodes ("/**"). Raises ScenarioError.

    data: content of the file at `path`; node: name without a namespace, in which it may be; needs: end of the message.
    """
    found: dict[str, Any] = {}
    names = [name for name in map(str, data) if name.rpartition("/")[2] in ("**", node)]
    for name in sorted(names, key=lambda name: (not name.endswith("**"), "*" not in name)):
        part = data[name]
        if isinstance(part, dict) and isinstance(part.get("ros__parameters"), dict):
            found |= part["ros__parameters"]
    if not found:
        missing = "ros__parameters" if names else node
        raise ScenarioError([f"{path}: has no {missing}; {needs}"])
    return found


def substituted(value: Any, values: Mapping[str, Any]) -> Any:
    """Return a parameter with $(var NAME) replaced by the value of that name; names without a value stay."""
    if isinstance(value, list):
        return [substituted(item, values) for item in value]
    if not isinstance(value, str):
        return value
    whole = VARIABLE.fullmatch(value.strip())
    if whole and whole[1] in values:
        return values[whole[1]]
    return VARIABLE.sub(lambda match: str(values.get(match[1], match[0])), value)


def occupancy(path: Path) -> Occupancy:
    """Voxelise the STL models listed in a GADEN configuration; return the grid, cut to its air and outlets.

    Raises WindFileError.
    """
    try:
        config = configuration(path)
    except ScenarioError as error:
        raise WindFileError(error.faults[0]) from None
    size = number(config.get("cell_size", 0.1), 1e-3, 100.0)
    if size is None:
        raise WindFileError(f"{path}: cell_size: got {config['cell_size']!r}, must be from 0.001 to 100 m")
    remarks: list[str] = []
    models, outlets = (_triangles(path, config, key, remarks) for key in ("models", "outlets_models"))
    if not len(models):
        raise WindFileError(f"{path}: models: lists no STL file")
    corners = np.concatenate([models, outlets]).reshape(-1, 3)
    low = corners.min(axis=0)
    count = np.maximum(np.ceil((corners.max(axis=0) - low) / size - TOUCH), 1.0)
    if count.prod() > MOST_VOXELS:
        raise WindFileError(
            f"{path}: cell_size: {size:g} m makes {count.prod():.3g} cells of the models; {MOST_VOXELS:,} are taken"
        )
    shape = tuple(count.astype(int))
    point = (_empty_point(path, config) - low) / size
    seed = tuple(np.floor(point + TOUCH).astype(int))
    if min(seed) < 0 or (np.array(seed) >= shape).any():
        raise WindFileError(f"{path}: empty_point: lies outside the models")
    cubes = np.full(shape, UNKNOWN, np.int8)
    for triangles, value in ((models, OBSTACLE), (outlets, OUTLET)):
        for body in _bodies((triangles - low) / size):
            corner = (body.min(axis=(0, 1)), body.max(axis=(0, 1)))
            begin, last = (np.clip(np.floor(x).astype(int), 0, count.astype(int) - 1) for x in corner)
            box = cubes[tuple(map(slice, begin, last + 1))]
            closed = _is_closed(body)
            if closed:
                inside = _inside(body - begin, box.shape)
                at = tuple(np.array(seed) - begin)
                if value == OBSTACLE and min(at) >= 0 and (at < np.array(box.shape)).all() and inside[at]:
                    hull = box[inside]
                    cubes[...] = OBSTACLE
                    box[inside] = hull
                    continue
                box[inside] = value
            for cells in _crossed(body - begin, box.shape, closed):
                box[tuple(cells.T)] = value
    return replace(_filled(path, cubes, seed, low, size), remarks=tuple(remarks))


def _filled(path: Path, cubes: np.ndarray, seed: tuple[int, ...], low: np.ndarray, size: float) -> Occupancy:
    """Return the grid with air flood-filled from voxel `seed`, without outer layers that are wholly solid."""
    if cubes[seed] == OBSTACLE:  # GADEN starts in a wall too, and continues to the cells beside
        cubes[seed] = UNKNOWN
    region: np.ndarray = ndimage.label(cubes == UNKNOWN)[0]  # type: ignore[index]
    air: np.ndarray = (region == region[seed]) & (cubes == UNKNOWN)
    if air.sum() < 2:
        raise WindFileError(f"{path}: empty_point: lies in no air; name a point in the room")
    cubes[cubes == UNKNOWN] = OBSTACLE
    cubes[air] = AIR
    (box,) = ndimage.find_objects((cubes != OBSTACLE).astype(int))
    return Occupancy(path, low + size * np.array([side.start for side in box]), size, cubes[box])


def _empty_point(path: Path, config: Mapping[str, Any]) -> np.ndarray:
    seed = config.get("empty_point", [config.get(f"empty_point_{axis}", 0.0) for axis in "xyz"])
    point = [number(x, -1e9, 1e9) for x in seed] if isinstance(seed, list) else []
    if len(point) != 3 or None in point:
        raise WindFileError(f"{path}: empty_point: got {seed!r}, must be three numbers in m")
    return np.array(point, float)


def number(value: object, least: float, most: float) -> float | None:
    """Return a YAML value as a float; None if it is no number from `least` to `most`."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        return None
    return float(value) if isfinite(value) else None


# ---------------------------------------------------------------- models


def models_of(path: Path, config: Mapping[str, Any], key: str) -> list[str]:
    """Return the names of STL files at key `models` or `outlets_models` of a configuration. Raises WindFileError."""
    listed = config.get(key)
    if listed is None:  # the older form: model_0, model_1
        old = {"models": ("model",), "outlets_models": ("outlets_model", "outlet_model")}[key]
        keys = [f"{name}_{n}" for name in old for n in range(len(config))]
        listed = [config[key] for key in keys if key in config]
    if isinstance(listed, str) and listed.lower().endswith(".stl"):
        listed = [listed]
    if isinstance(listed, str) and VARIABLE.search(listed):
        raise WindFileError(
            f"{path}: {key}: {listed} stands for a list in simulations/; name a file of that folder"
        )
    if not isinstance(listed, list):
        raise WindFileError(f"{path}: {key}: got {listed!r}, must be a list of STL files")
    names = [name for name in listed if isinstance(name, str) and not name.startswith("!")]
    return [name for name in names if name.lower().endswith(".stl")]


def located(path: Path, name: str) -> tuple[Path, str]:
    """Return the path of a file named in a configuration, and a remark if the file lies elsewhere.

    Names may begin with a ROS variable or `package://`, which stand for a package around the project, or be those of
    another computer: their ends are looked up in the project's folder and in three folders above. If the file does not
    exist, the stated path is returned.
    """
    home = path.parent.parent if path.name == OLD or _is_simulation(path) else path.parent
    plain = PACKAGE.sub("", name, count=1)
    if plain == name and os.path.isfile(home / name):
        return home / name, ""
    found = moved(name, [home, *home.parents[:3]])
    if found is None:
        return home / plain, ""
    is_stated = plain != name and found.as_posix().endswith(f"/{plain}")
    return (
        found,
        "" if is_stated else f"{name} is not there; {os.path.relpath(found, home)} in {home} is read",
    )


def _triangles(path: Path, config: Mapping[str, Any], key: str, remarks: list[str]) -> np.ndarray:
    """Return the corners (n, 3, 3) [m] of all triangles of the STL files under a key of a configuration.

    Adds to the remarks files that lie elsewhere.
    """
    parts = [np.empty((0, 3, 3))]
    for name in models_of(path, config, key):
        file, remark = located(path, name)
        remarks += [f"{key}: {remark}"] if remark else []
        try:
            mesh = read_mesh(file)
        except MeshError as error:
            raise WindFileError(f"{path}: {key}: {error}") from None
        parts.append(mesh.vertices[mesh.triangles])
    return np.concatenate(parts)


# ---------------------------------------------------------------- voxels, as the unit of length


def _bodies(triangles: np.ndarray) -> list[np.ndarray]:
    """Split triangles (m, 3, 3) into connected bodies: triangles that share corners."""
    if not len(triangles):
        return []
    corner = _corners(triangles)
    ends = np.concatenate([corner[:, :2], corner[:, 1:]])
    graph = coo_matrix((np.ones(len(ends), bool), tuple(ends.T)), shape=(corner.max() + 1,) * 2)
    body = connected_components(graph, directed=False)[1][corner[:, 0]]
    order = np.argsort(body, kind="stable")
    return np.split(triangles[order], np.flatnonzero(np.diff(body[order])) + 1)


def _corners(triangles: np.ndarray) -> np.ndarray:
    """Return vertex indices (m, 3) of triangles (m, 3, 3), with one index per distinct position."""
    places = np.round(triangles.reshape(-1, 3) / SAME).astype(np.int64)
    return np.unique(places, axis=0, return_inverse=True)[1].reshape(-1, 3)


def _is_closed(triangles: np.ndarray) -> bool:
    """Return whether triangles form a closed surface: every edge belongs to an even number of triangles."""
    corner = _corners(triangles)
    edges = np.sort(np.concatenate([corner[:, [0, 1]], corner[:, [1, 2]], corner[:, [2, 0]]]), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    return bool((np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all())


def _inside(triangles: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return a mask of the voxels whose centre is inside a closed body, by counting crossings of rays along x."""
    crossings = np.zeros((shape[0] + 1, *shape[1:]), bool)
    offset = np.array([2e-7, 3e-7])  # from the centre of a column: no ray runs through an edge
    flat = triangles[..., 1:]
    low = np.clip(np.floor(flat.min(axis=1)), 0, np.array(shape[1:]) - 1).astype(int)
    high = np.clip(np.floor(flat.max(axis=1)), 0, np.array(shape[1:]) - 1).astype(int)
    for which, cells in _pairs(low, high):
        a, b, c = (flat[which, n] - (cells + 0.5 + offset) for n in range(3))
        weights = np.stack([_area(b, c), _area(c, a), _area(a, b)], axis=-1)
        total = weights.sum(axis=1)
        met = ((weights > 0).all(axis=1) | (weights < 0).all(axis=1)) & (total != 0)
        x = (weights[met] * triangles[which[met], :, 0]).sum(axis=1) / total[met]
        first = np.clip(np.ceil(x - 0.5), 0, shape[0]).astype(int)  # the first centre beyond
        np.logical_xor.at(crossings, (first, *cells[met].T), True)
    return np.logical_xor.accumulate(crossings, axis=0)[:-1]


def _area(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _crossed(triangles: np.ndarray, shape: tuple[int, ...], closed: bool) -> Iterator[np.ndarray]:
    """Yield indices (n, 3) of voxels that triangles (m, 3, 3) cut; voxels that a closed body only touches are left out.

    Separating axes: T. Akenine-Möller, "Fast 3D triangle-box overlap testing", 2001.
    """
    low = np.clip(np.floor(triangles.min(axis=1) + TOUCH), 0, np.array(shape) - 1).astype(int)
    high = np.clip(np.floor(triangles.max(axis=1) + TOUCH), 0, np.array(shape) - 1).astype(int)
    half = np.full(triangles[:, 0].shape, 0.5 - 2 * TOUCH)
    if not closed:
        half[np.ptp(triangles, axis=1) < TOUCH] = 0.5 + 2 * TOUCH
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    offset, reach = (triangles[:, 0] * normal).sum(axis=1), (half * np.abs(normal)).sum(axis=1)
    for which, cells in _pairs(low, high):
        away = np.einsum("nd,nd->n", normal[which], cells + 0.5) - offset[which]
        near = np.abs(away) <= reach[which]  # the plane of the triangle passes through the voxel
        which, cells = which[near], cells[near]
        yield cells[_overlap(triangles[which] - (cells + 0.5)[:, None], half[which])]


def _pairs(low: np.ndarray, high: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield chunks of (triangle indices, voxels): all voxels from low[n] to high[n], (m, axes), of each triangle n."""
    spans = high - low + 1
    total = np.concatenate([[0], np.cumsum(spans.prod(axis=1))])
    for begin in range(0, int(total[-1]), CHUNK):
        pair = np.arange(begin, min(begin + CHUNK, int(total[-1])))
        which = np.searchsorted(total, pair, side="right") - 1
        left, steps = pair - total[which], []
        for span in spans[which].T[::-1]:
            steps.append(left % span)
            left = left // span
        yield which, low[which] + np.stack(steps[::-1], axis=-1)


def _overlap(corners: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return indices of triangles (n, 3, 3) that intersect boxes at the origin, whose planes are known to.

    half: half the edges of the boxes (n, 3).
    """
    near = (corners.min(axis=1) <= half) & (corners.max(axis=1) >= -half)
    meets = np.flatnonzero(near.all(axis=1))
    corners, half = corners[meets], half[meets]
    edges = np.roll(corners, -1, axis=1) - corners
    apart = np.zeros(len(meets), bool)
    for edge in edges.transpose(1, 2, 0):
        for b, c in ((1, 2), (2, 0), (0, 1)):  # the cross product of the edge and an axis of the grid
            along = edge[b] * corners[:, :, c].T - edge[c] * corners[:, :, b].T
            reach = np.abs(edge[b]) * half[:, c] + np.abs(edge[c]) * half[:, b]
            apart |= (along.min(axis=0) > reach) | (along.max(axis=0) < -reach)
    return meets[~apart]
