"""The benchmark of the live service, in small: nothing that comes ends it, and a robot that was cut off comes back."""

import pytest

pytest.importorskip("zenoh")

from taichi_plume.validation.benchmark.live import measure

pytestmark = pytest.mark.slow


def test_clients_noise_and_a_link_that_is_cut():
    reported = measure(seconds=12.0, clients=6, malformed=400)
    assert reported["exit code"] == 0
    assert reported["ticks"] == 120
    assert reported["messages malformed"] + reported["messages oversized"] > 350
    assert reported["messages never_heard"] == 0
    assert reported["commands"] > 100
    assert reported["cut [s]"] == pytest.approx(2.4)
    assert reported["longest gap of robot 2 [ticks]"] > 20
    assert reported["messages times_lost"] >= 1
    assert reported["robot 2 was reported back"]
    assert not reported["robot 2 lost at the end"]
