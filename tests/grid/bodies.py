"""Bodies shared by tests of geometry, in a room and on a floor."""

from math import sqrt

import numpy as np

from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Box, Cylinder, Prism, Sphere

ROOM = Domain(size=(4.0, 3.0, 1.0), spacing=0.1)
FLOOR = Domain(size=(4.0, 3.0), spacing=0.1)
L_SHAPE = ((1.0, 0.5), (3.0, 0.5), (3.0, 1.5), (2.0, 1.5), (2.0, 2.5), (1.0, 2.5))
SHAPES = {
    "box": Box(kind="box", center=(2.0, 1.4, 0.3), size=(1.0, 0.5, 0.4), yaw_deg=30.0),
    "cylinder": Cylinder(kind="cylinder", center=(1.8, 1.6), radius=0.5, base=0.2, height=0.5),
    "column": Cylinder(kind="cylinder", center=(1.8, 1.6), radius=0.5),
    "sphere": Sphere(kind="sphere", center=(2.1, 1.3, 0.4), radius=0.35),
    "prism": Prism(kind="prism", vertices=L_SHAPE, base=0.1, height=0.6),
}


def is_inside(name, p):
    """Return which points lie in a body of SHAPES, by inequalities."""
    x, y, z = p[..., 0], p[..., 1], p[..., 2]
    if name == "box":
        u = (x - 2.0) * sqrt(0.75) + (y - 1.4) * 0.5
        v = (y - 1.4) * sqrt(0.75) - (x - 2.0) * 0.5
        return (abs(u) < 0.5) & (abs(v) < 0.25) & (abs(z - 0.3) < 0.2)
    if name == "cylinder":
        return ((x - 1.8) ** 2 + (y - 1.6) ** 2 < 0.25) & (z > 0.2) & (z < 0.7)
    if name == "column":
        return ((x - 1.8) ** 2 + (y - 1.6) ** 2 < 0.25) & (z > 0.0) & (z < 1.0)
    if name == "sphere":
        return (x - 2.1) ** 2 + (y - 1.3) ** 2 + (z - 0.4) ** 2 < 0.35**2
    low = (x > 1) & (x < 3) & (y > 0.5) & (y < 1.5)
    return (low | ((x > 1) & (x < 2) & (y > 0.5) & (y < 2.5))) & (z > 0.1) & (z < 0.7)


def random_points(n=20_000, dim=3, seed=0):
    return np.random.default_rng(seed).uniform(0.0, [4.0, 3.0, 1.0][:dim], (n, dim))
