"""Extent of a flow at points: nodes or centres of cells, as their positions say."""

import numpy as np
import pytest

from taichi_plume.grid.interpolation import Interpolation
from taichi_plume.grid.point_box import box_of


def cells(low, edges, spacing, stand):
    """Points of a mesh of equal cells that fills a box, in random order."""
    axes = []
    for start, edge in zip(low, edges, strict=True):
        count = round(edge / spacing)
        nodes = start + spacing * np.arange(count + 1)
        axes.append(nodes if stand == "nodes" else (nodes[1:] + nodes[:-1]) / 2)
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    return np.random.default_rng(1).permutation(place)


@pytest.mark.parametrize("stand", ["nodes", "centres"])
@pytest.mark.parametrize(
    ("low", "edges", "spacing", "domain"),
    [
        ((0, 0), (4, 3), 0.5, (2, 2)),  # the origin says it
        ((0, 0, 0), (3, 2, 1), 0.25, (3, 2)),
        ((-3.1, 2.03), (4, 3), 0.5, (4, 3)),  # the domain does
    ],
)
def test_positions_say_what_points_are(stand, low, edges, spacing, domain):
    box = box_of(Interpolation(cells(low, edges, spacing, stand)), domain)
    assert (box.stand, box.is_known) == (stand, True)
    np.testing.assert_allclose(box.low, low, atol=1e-9)
    np.testing.assert_allclose(box.high, np.add(low, edges), atol=1e-9)


def test_contradictions_and_bare_multiples_are_assumed():
    """Nodes of half a metre on fit a domain as nodes, though centres start there; a grid about 0 says nothing."""
    box = box_of(Interpolation(cells((0.5, 0.5), (4, 3), 1.0, "nodes")), (4, 3))
    assert (box.stand, box.is_known) == ("nodes", False)
    around = np.stack(np.meshgrid(*[np.linspace(-1, 1, 21)] * 2), axis=-1).reshape(-1, 2)
    assert not box_of(Interpolation(around), (1.5, 1.5)).is_known
    slices = np.stack(np.meshgrid(*[np.arange(-2, 2.1, 0.5)] * 2, [0.25, 0.75], indexing="ij"), -1).reshape(
        -1, 3
    )
    assert not box_of(Interpolation(slices), (3, 3)).is_known


def test_what_nothing_says_is_assumed_unless_stated():
    points = Interpolation(cells((0.13, 0.29), (4, 3), 0.5, "nodes"))
    box = box_of(points, (2, 2))
    assert (box.stand, box.is_known) == ("centres", False)
    np.testing.assert_allclose(box.low, [-0.12, 0.04], atol=1e-9)
    stated = box_of(points, (2, 2), "nodes")
    assert (stated.stand, stated.is_known) == ("nodes", True)
    np.testing.assert_allclose(stated.high, [4.13, 3.29], atol=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_scattered_nodes_have_a_boundary_and_scattered_centres_have_none(dim):
    rng, low, edges = np.random.default_rng(3), np.full(dim, 0.37), np.full(dim, 2.0)
    nodes = cells(low, edges, 0.2, "nodes")
    inner = ((nodes > low + 1e-6) & (nodes < low + edges - 1e-6)).all(axis=1)
    nodes[inner] += rng.uniform(-0.06, 0.06, (inner.sum(), dim))
    box = box_of(Interpolation(nodes), (edges / 2).tolist())
    assert box.stand == "nodes"
    np.testing.assert_allclose(box.low, low, atol=1e-9)
    centres = cells(low, edges, 0.2, "centres") + rng.uniform(-0.02, 0.02, (10**dim, dim))
    box = box_of(Interpolation(centres), edges.tolist())
    assert box.stand == "centres"
    np.testing.assert_allclose(box.low, low, atol=0.05)


def test_nodes_with_an_obstacle_cut_out_are_a_lattice():
    nodes = cells((0, 0), (2, 1), 0.1, "nodes")
    nodes = nodes[~((nodes > [0.55, 0.25]) & (nodes < [1.05, 0.75])).all(axis=1)]
    box = box_of(Interpolation(nodes), (1.5, 1))
    assert box.stand == "nodes"
    np.testing.assert_allclose([box.low, box.high], [[0, 0], [2, 1]], atol=1e-9)
    assert box_of(Interpolation(nodes + 0.05), (1.5, 1)).stand == "centres"
