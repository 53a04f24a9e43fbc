"""Steady dispersion: closed form, reciprocity of source and receptor, fluxes, walls."""

import numpy as np
import pytest
from scipy.special import k0e

from taichi_plume.agents.dispersion import Dispersion

SHAPES = [(30, 22), (14, 10, 7)]


def room(shape, lifetime=None):
    """Wind with a mean along x and disturbances, around a wall across half of the room."""
    rng = np.random.default_rng(1)
    wind = 0.06 * rng.normal(size=(*shape, len(shape)))
    wind[..., 0] += 0.3
    if len(shape) == 3:
        wind[..., 2] = 0.0  # floor and ceiling are closed
    solid = np.zeros(shape, bool)
    solid[shape[0] // 2, : shape[1] // 2] = True
    return Dispersion(wind, 0.1, solid, diffusivity=0.01, lifetime=lifetime, depth=0.5)


def test_line_source_in_uniform_wind():
    """c = Q / (2 pi K H) exp(U x / 2K) K0(U r / 2K) of a line source in an infinite layer of depth H."""
    h, speed, diffusivity, rate, depth = 0.025, 0.3, 0.02, 2e-6, 0.5
    shape = (120, 100)
    wind = np.zeros((*shape, 2))
    wind[..., 0] = speed
    model = Dispersion(wind, h, diffusivity=diffusivity, depth=depth)
    source = (24, 50)
    rates = np.zeros(shape)
    rates[source] = rate
    c = model.concentration(rates)
    x, y = ((np.indices(shape)[d] - source[d]) * h for d in range(2))
    r = np.maximum(np.hypot(x, y), h)
    by = speed / (2 * diffusivity)
    exact = rate / (2 * np.pi * diffusivity * depth) * np.exp(by * (x - r)) * k0e(by * r)
    away = (x > 0.3) & (x < 1.8) & (np.abs(y) < 0.6)
    assert np.abs(c - exact)[away].max() < 0.02 * exact[away].max()


@pytest.mark.parametrize("shape", SHAPES)
def test_reciprocity_of_source_and_receptor(shape):
    """The weighted concentrations of any sources are the adjoint of the weights, summed over these sources."""
    model, rng = room(shape), np.random.default_rng(2)
    rates, weights = rng.random((2, *shape)) * ~model.solid
    forward = (weights * model.concentration(rates)).sum()
    assert (model.adjoint(weights) * rates).sum() == pytest.approx(forward, rel=1e-9)


def test_reciprocity_of_many_cells(monkeypatch):
    """Iterations take the place of the factorisation."""
    monkeypatch.setattr("taichi_plume.agents.dispersion.MOST_DIRECT", 10)
    model, rng = room((14, 10, 7)), np.random.default_rng(2)
    rates, weights = rng.random((2, 14, 10, 7)) * ~model.solid
    forward = (weights * model.concentration(rates)).sum()
    assert (model.adjoint(weights) * rates).sum() == pytest.approx(forward, rel=1e-6)


def test_gradient_in_the_sources():
    """The adjoint of dJ/dc is the gradient of J in the rates, here of a sum of squared misfits."""
    model, rng = room((12, 9)), np.random.default_rng(3)
    rates, wanted = rng.random((2, 12, 9)) * ~model.solid
    c = model.concentration(rates)
    gradient = model.adjoint(2 * (c - wanted))
    change = 1e-6 * rng.normal(size=rates.shape) * ~model.solid
    ends = (((model.concentration(rates + sign * change) - wanted) ** 2).sum() for sign in (1, -1))
    up, down = ends
    assert (gradient * change).sum() == pytest.approx((up - down) / 2, rel=1e-5)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("lifetime", [None, 20.0])
def test_all_gas_leaves_or_is_lost(shape, lifetime):
    model = room(shape, lifetime)
    rates = np.zeros(shape)
    rates[(2, *(n // 3 for n in shape[1:]))] = 1e-6
    c = model.concentration(rates)
    edge, outflow = model.edges
    leaves = model.area * (np.maximum(outflow, 0.0) * c.ravel()[edge]).sum()
    lost = 0.0 if lifetime is None else model.volume * c.sum() / lifetime
    assert leaves + lost == pytest.approx(1e-6, rel=1e-9)
    assert c.min() >= 0.0
    assert not c[model.solid].any()


@pytest.mark.parametrize("shape", SHAPES)
def test_mass_consistent_wind(shape):
    """No cell has divergence; a wind that has none stays as it is."""
    model = room(shape)
    divergence = np.zeros(model.solid.size)
    for lower, upper, speed in model.faces:
        np.add.at(divergence, lower, speed)
        np.add.at(divergence, upper, -speed)
    np.add.at(divergence, *model.edges)
    assert np.abs(divergence).max() < 1e-6
    uniform = np.zeros((*shape, len(shape)))
    uniform[..., 0] = 0.3
    assert Dispersion(uniform, 0.1).wind == pytest.approx(uniform)


def test_wall_shields():
    """A room that a wall parts: no gas behind the wall."""
    wind = np.zeros((20, 10, 2))
    solid = np.zeros((20, 10), bool)
    solid[10] = True
    model = Dispersion(wind, 0.1, solid, lifetime=100.0)
    rates = np.zeros((20, 10))
    rates[4, 4] = 1e-6
    c = model.concentration(rates)
    assert c[:10].min() > 0.0
    assert not c[10:].any()


def test_weights_of_a_point():
    """Linear interpolation reproduces a linear field."""
    model = Dispersion(np.ones((6, 5, 2)), 0.2)
    x, y = (np.indices((6, 5)) + 0.5) * 0.2
    weights = model.at((1.53, 0.62), low=(0.5, 0.0))
    assert (weights * (3 * x + y)).sum() == pytest.approx(3 * 1.03 + 0.62)


@pytest.mark.parametrize(
    ("changes", "key", "limit"),
    [
        ({"wind": np.zeros((4, 4, 3))}, "wind", "(nx, ny, 2)"),
        ({"wind": np.full((4, 4, 2), np.nan)}, "wind", "finite"),
        ({"solid": np.zeros((4, 3), bool)}, "solid", "(4, 4)"),
        ({"cell": 0.0}, "cell", "above 0"),
        ({"diffusivity": -1.0}, "diffusivity", "above 0"),
        ({"lifetime": 0.0}, "lifetime", "above 0"),
        ({"open_edges": False}, "lifetime", "edge"),
    ],
)
def test_bad_input(changes, key, limit):
    with pytest.raises(ValueError, match=key) as error:
        Dispersion(**({"wind": np.ones((4, 4, 2)), "cell": 0.1} | changes)).concentration(np.ones((4, 4)))
    assert limit in str(error.value)
