"""Size of the arena as drawn in a recording, and rerun archetypes placed in it: pictures, texts and meshes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike

from taichi_plume.grid.outlines import Mesh
from taichi_plume.observed.planes import Plane

FLAT = 0.05  # height of the walls of a 2-D arena over its shorter side


@dataclass(frozen=True)
class Stage:
    """Arena as drawn in a recording: extent, height of the walls, longer side, gap between flat objects [m]."""

    extent: tuple[float, ...]
    height: float
    length: float
    lift: float

    @property
    def size(self) -> tuple[float, float, float]:
        """Size of the drawn room along x, y and z [m]."""
        return self.extent[0], self.extent[1], self.height

    @staticmethod
    def of(extent: tuple[float, ...]) -> "Stage":
        """Return the dimensions of an arena [m] as drawn; 2-D arenas get low walls."""
        length = max(extent[:2])
        return Stage(extent, extent[2] if len(extent) == 3 else FLAT * min(extent), length, 5e-4 * length)


def placed(plane: Plane, points: ArrayLike, stage: Stage, above: float = 1.0) -> np.ndarray:
    """Return points (n, 2) [m], given in a plane's two axes, as 3-D points (n, 3) for drawing.

    The points lie `above` times `stage.lift` towards the viewer. Horizontal planes lie on the floor at any height.
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
    """Return the quaternion that rotates a picture from the xy plane into a plane of orientation xy, xz or yz."""
    half = 0.5**0.5
    turns = {"xy": [0.0, 0.0, 0.0, 1.0], "xz": [half, 0.0, 0.0, half], "yz": [0.5, 0.5, 0.5, 0.5]}
    return rr.Quaternion(xyzw=turns[plane.letters])


def picture(
    plane: Plane, shape: tuple[int, ...], cell: float, origin: tuple[float, ...], stage: Stage, **how: Any
) -> rr.GridMap:
    """Return a picture (rerun GridMap) in a plane; shape, cell: of pixels; origin: lower left corner in it [m]."""
    above = how.pop("above", 1.0)
    return rr.GridMap.from_fields(
        format=picture_format(shape[0], shape[1], how.pop("color", False)),
        cell_size=cell,
        translation=placed(plane, [origin], stage, above)[0],
        quaternion=turned(plane),
        **how,
    )


def label(text: str, position: ArrayLike, color: tuple[int, ...]) -> rr.Points3D:
    """Return a rerun archetype that shows a text at a 3-D position [m]."""
    return rr.Points3D(
        [position], radii=rr.Radius.ui_points(0.0), colors=color, labels=[text], show_labels=True
    )


def mesh(of: Mesh, color: tuple[int, ...]) -> rr.Mesh3D:
    """Return a triangle mesh of one colour as a rerun archetype."""
    return rr.Mesh3D(
        vertex_positions=of.vertices,
        triangle_indices=of.triangles,
        vertex_normals=of.normals,
        albedo_factor=color,
    )


def picture_format(width: int, height: int, color: bool) -> rr.components.ImageFormat:
    """Return the rerun image format of a picture: RGBA if `color`, else one byte per pixel that the viewer colours."""
    model = "RGBA" if color else "L"
    return rr.components.ImageFormat(width=width, height=height, color_model=model, channel_datatype="U8")
