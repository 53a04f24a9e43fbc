"""The benchmark of the live service, in small: nothing that comes ends it, and a robot that was cut off comes back."""

import pytest

pytest.importorskip("zenoh")

from taichi_plume.validation.benchmark.live import measure

pytestmark = pytest.mark.slow


def test_clients_noise_and_a_link_that_is_cut():
    told = measure(seconds=12.0, clients=6, malformed=400)
    assert told["exit code"] == 0
    assert told["ticks"] == 120
    assert told["messages malformed"] + told["messages oversized"] > 350
    assert told["messages never_heard"] == 0
    assert told["commands"] > 100
    assert told["cut [s]"] == pytest.approx(2.4)
    assert told["longest gap of robot 2 [ticks]"] > 20
    assert told["messages times_lost"] >= 1
    assert told["robot 2 was reported back"]
    assert not told["robot 2 lost at the end"]
