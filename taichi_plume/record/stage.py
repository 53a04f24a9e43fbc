"""The stage of a recording: how large things are drawn, and how pictures, texts and meshes are placed on it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from taichi_plume.record.planes import Plane
from taichi_plume.simulation import Simulation

FLAT = 0.05  # height of the walls of a 2-D arena over its shorter side


@dataclass(frozen=True)
class Stage:
    """The arena as drawn: floor [m], height of its walls, longer side, gap between what lies on the floor."""

    extent: tuple[float, ...]
    height: float
    length: float
    lift: float

    @staticmethod
    def of(sim: Simulation) -> "Stage":
        """That of a simulation; flat ones get low walls."""
        extent = sim.grid.extent
        length = max(extent[:2])
        return Stage(extent, extent[2] if len(extent) == 3 else FLAT * min(extent), length, 5e-4 * length)


def placed(plane: Plane, points: Any, stage: Stage, above: float = 1.0) -> np.ndarray:
    """Points (n, 2) [m] in a plane's axes as (n, 3), so many `stage.lift` on the viewer's side of the plane.

    Horizontal planes lie on the floor, whatever their height.
    """
    points = np.asarray(points, float)
    found = np.zeros((len(points), 3))
    found[:, list(plane.axes)] = points
    if plane.letters == "xy":
        found[:, 2] = above * stage.lift
    else:
        side = -1.0 if plane.normal == 1 else 1.0
        found[:, plane.normal] = (plane.level or 0.0) + side * above * stage.lift
    return found


def turned(plane: Plane) -> rr.Quaternion:
    """Quaternion that turns a picture's axes into those of the plane."""
    half = 0.5**0.5
    turns = {"xy": [0.0, 0.0, 0.0, 1.0], "xz": [half, 0.0, 0.0, half], "yz": [0.5, 0.5, 0.5, 0.5]}
    return rr.Quaternion(xyzw=turns[plane.letters])


def picture(
    plane: Plane, shape: tuple[int, ...], cell: float, origin: Any, stage: Stage, **how: Any
) -> rr.GridMap:
    """A GridMap that lies in a plane, its lower left corner at `origin` in the plane's axes [m]; without pixels."""
    above = how.pop("above", 1.0)
    return rr.GridMap.from_fields(
        format=picture_format(shape[0], shape[1], how.pop("color", False)),
        cell_size=cell,
        translation=placed(plane, [origin], stage, above)[0],
        quaternion=turned(plane),
        **how,
    )


def label(text: str, position: Any, color: tuple[int, ...]) -> rr.Points3D:
    """A text at a place."""
    return rr.Points3D(
        [position], radii=rr.Radius.ui_points(0.0), colors=color, labels=[text], show_labels=True
    )


def mesh(
    vertices: np.ndarray, triangles: np.ndarray, normals: np.ndarray, color: tuple[int, ...]
) -> rr.Mesh3D:
    """A mesh of one colour."""
    return rr.Mesh3D(
        vertex_positions=vertices, triangle_indices=triangles, vertex_normals=normals, albedo_factor=color
    )


def picture_format(width: int, height: int, color: bool) -> rr.components.ImageFormat:
    """Of a GridMap's bytes: RGBA, or one byte that the viewer colours."""
    model = "RGBA" if color else "L"
    return rr.components.ImageFormat(width=width, height=height, color_model=model, channel_datatype="U8")
