"""A quantity that is declared in QUANTITIES alone is in live topics, in bags and in the file of the drawn room."""

from math import inf
from pathlib import Path

import numpy as np
import pytest

from taichi_plume import open_run
from taichi_plume.assembly.assemble import assemble
from taichi_plume.execution import latest_instant
from taichi_plume.execution.signals import SignalRequests
from taichi_plume.observed import quantities
from taichi_plume.observed.quantities import Quantity, Rounded
from taichi_plume.observed.scales import Scale
from taichi_plume.results import bag_of_run

pytestmark = pytest.mark.usefixtures("taichi")
HEIGHT = 0.32  # m, of slices and sensors; between the centres of two layers of cells
SCENARIO = {
    "name": "dosed", "duration": 2, "domain": {"size": [1.2, 0.8, 0.6], "spacing": 0.1},
    "wind": {"kind": "uniform", "velocity": [0.2, 0, 0]},
    "gas": {"kind": "eulerian", "sources": [{"position": [0.3, 0.4, 0.3], "rate": "1 mg/s"}]},
    "robots": [
        {
            "name": "team", "count": 1, "start": {"kind": "positions", "positions": [[1.0, 0.4]]},
            "algorithm": {"kind": "external"}, "sensors": {"gas": {"kind": "ideal", "height": HEIGHT}},
        }
    ],
    "recording": {"rate": 1, "slice_height": [HEIGHT]},
}  # fmt: skip


def dose(places: np.ndarray, t: float) -> np.ndarray:
    """Return a dose at positions (..., 3) [m] that is linear in space, so that pictures show it without an error."""
    return (1.0 + places @ np.array([1.0, 2.0, 4.0]) + 0.5 * t).astype(np.float32)


@pytest.fixture
def declared(monkeypatch):
    """Declaration of the dose as a quantity of all simulations."""

    def doses(sim):
        yield Quantity(
            "dose", "dose", "1", Scale(0.0, 8.0, "linear"), "turbo",
            lambda sim: dose(sim.grid.centers(), sim.t), None, Rounded(), in_cells="dose",
        )  # fmt: skip

    monkeypatch.setattr(quantities, "QUANTITIES", [*quantities.QUANTITIES, doses])


def test_the_file_of_the_drawn_room_has_it(declared, tmp_path):
    import taichi_plume as tp

    scenario = SCENARIO | {"robots": []}
    with tp.Simulation(scenario) as sim:
        file = latest_instant.InstantFile(sim.loop, tmp_path / "w.npz")
        sim.run(until=1)
        file.written = -inf
        file.update(sim.loop)
    instant = latest_instant.read(tmp_path / "w.npz")
    assert list(instant.pictures) == ["gas_slice", "gas_column", "dose_slice", "dose_column"]
    shown = instant.pictures["dose_slice"]
    assert (shown.quantity, shown.unit, shown.scale) == (
        f"dose · {HEIGHT:g} m above the floor",
        "1",
        Scale(0.0, 8.0, "linear"),
    )
    x, y = np.meshgrid((np.arange(12) + 0.5) * 0.1, (np.arange(8) + 0.5) * 0.1)
    places = np.stack([x, y, np.full_like(x, HEIGHT)], axis=-1)
    np.testing.assert_allclose(shown.values, dose(places, 1.0), rtol=1e-6)


def test_clients_of_the_live_service_get_it(declared):
    pytest.importorskip("rosbags")
    from taichi_plume.files import ros_messages as ros
    from taichi_plume.scenario.loading import scenario_from
    from taichi_plume.serve.service import Pace, Service

    class Client:
        """Link of a subscriber of doses. offered: all topics; got: bytes of the messages."""

        def __init__(self):
            self.offered, self.got = set(), []

        def wants(self, topic, name):
            self.offered.add((topic, name))
            return topic == "plume/dose"

        def publish(self, topic, data):
            self.got.append(data)

        def listen(self, incoming, stray): ...

        def announce_time(self, t): ...

        def close(self): ...

    client = Client()
    sim = assemble(scenario_from(SCENARIO), driven=True)
    service = Service(Pace(inf, at_once=True), [client], quiet=True)
    service.attach(sim, SignalRequests())
    sim.run()
    service.close()
    assert {("plume/ethanol", ros.POINTS), ("plume/dose", ros.POINTS)} <= client.offered
    assert len(client.got) == 3, "one message per second"
    for t, data in enumerate(client.got):
        message = ros.decode(ros.POINTS, data)
        points = ros.points_of(message)
        assert list(points) == ["x", "y", "z", "value"]
        assert len(points["x"]) == 12 * 8
        places = np.stack([points[axis] for axis in "xyz"], axis=-1)
        assert places[:, 2] == pytest.approx(HEIGHT)
        np.testing.assert_allclose(points["value"], dose(places, t), rtol=1e-6)


@pytest.mark.slow
def test_a_bag_of_a_run_without_fields_has_the_recorded_slice(declared, tmp_path):
    pytest.importorskip("rosbags")
    from rosbags.highlevel import AnyReader

    import taichi_plume as tp
    from taichi_plume.files import ros_messages as ros

    folder = tp.simulate(SCENARIO | {"robots": []}, out=tmp_path / "run", progress=False).folder
    bag_of_run.write(open_run(folder), tmp_path / "bag", least=0.01)
    found = {}
    with AnyReader([Path(tmp_path / "bag")]) as reader:
        for one, t, data in reader.messages():
            if one.topic.startswith("/plume/"):
                found.setdefault(one.topic, {})[t * 1e-9] = ros.points_of(
                    reader.deserialize(data, one.msgtype)
                )
    assert {topic: list(clouds) for topic, clouds in found.items()} == {
        "/plume/ethanol": [0, 1, 2], "/plume/dose": [0, 1, 2]
    }  # fmt: skip
    for t, points in found["/plume/dose"].items():
        places = np.stack([points[axis] for axis in "xyz"], axis=-1)
        assert len(places) == 12 * 8
        np.testing.assert_allclose(points["value"], dose(places, t), rtol=2**-11)
    gas = tp.open_run(folder).pictures.gas_slice.isel(time=-1).values
    points = found["/plume/ethanol"][2]
    assert list(points) == ["x", "y", "z", "ppm"]
    np.testing.assert_array_equal(points["ppm"], gas[gas >= 0.01])
