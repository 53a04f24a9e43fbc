"""Memory of closed simulations is free for others. In a file of its own: a simulation in use would keep kernels."""

import gc

import psutil
import pytest
from test_simulate import DATA

import taichi_plume as tp

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.mark.slow
def test_twenty_simulations_take_the_memory_of_a_few():
    process, sizes = psutil.Process(), []
    for seed in range(20):
        with tp.Simulation(DATA, seed=seed) as sim:
            sim.run()
        gc.collect()
        sizes.append(process.memory_info().rss)
    assert sizes[-1] - sizes[9] < 40e6  # bytes; ten such simulations kept alive would take 200 MB
