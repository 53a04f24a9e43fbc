"""The launch file and the layout of Foxglove name topics that the service has for this room."""

import ast
import json
import re
from math import inf
from pathlib import Path

import pytest

from taichi_plume.assembly.assemble import build
from taichi_plume.assembly.preparation import load
from taichi_plume.execution.signals import SignalRequests
from taichi_plume.serve.service import Pace, Service

pytest.importorskip("rosbags")
EXAMPLES = Path(__file__).parents[2] / "examples"
GAS = "{kind: gaussian_plume, diffusivity: 0.002, species: acetone, sources: [{position: [0.7, 1.45], rate: 20 mg/s}]}"
WIND = "{kind: uniform, velocity: [0.5, 0]}"
QUICK = ["duration=0.1", "warm_up=0", "obstacles=[]", f"wind={WIND}", f"gas={GAS}"]


class Listing:
    """Link that lists topics: outgoing ones with types and fields, incoming ones."""

    def __init__(self):
        self.types, self.incoming = {}, set()

    def listen(self, incoming, stray):
        self.incoming = set(incoming)

    def wants(self, topic, name):
        self.types[topic] = name
        return False

    def publish(self, topic, data):
        raise AssertionError("nothing is wanted")

    def announce_time(self, t):
        pass

    def close(self):
        pass


@pytest.mark.slow
@pytest.mark.usefixtures("taichi")
def test_topics_of_the_examples_are_those_of_the_service():
    link = Listing()
    service = Service(Pace(inf, at_once=True), [link], quiet=True)
    sim = build(load("live/room", QUICK), driven=True)
    service.attach(sim, SignalRequests())
    sim.run()
    service.close()

    configs = json.loads((EXAMPLES / "live_room.foxglove.json").read_text())["configById"]
    seen = {topic for config in configs.values() for topic in config.get("topics", ())}
    plotted = [path["value"].split(".") for config in configs.values() for path in config.get("paths", ())]
    assert len(seen) == 3
    assert len(plotted) == 3
    for topic in seen:
        assert topic.removeprefix("/") in link.types
    for topic, field in plotted:
        assert field in ("raw", "wind_speed")
        assert link.types[topic.removeprefix("/")].endswith("GasSensor" if field == "raw" else "Anemometer")
    assert configs["Teleop!drive"]["topic"].removeprefix("/") in link.incoming


def test_every_panel_of_the_layout_has_settings():
    layout = json.loads((EXAMPLES / "live_room.foxglove.json").read_text())

    def panels(part):
        return [part] if isinstance(part, str) else [*panels(part["first"]), *panels(part["second"])]

    assert sorted(panels(layout["layout"])) == sorted(layout["configById"])


def test_the_launch_file_drives_by_the_topic_of_the_layout():
    """The test above checks this topic; the launch file can only be read where ROS is installed."""
    text = (EXAMPLES / "live_room.launch.py").read_text()
    values = {
        node.targets[0].id: node.value.value
        for node in ast.parse(text).body
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant)
    }
    configs = json.loads((EXAMPLES / "live_room.foxglove.json").read_text())["configById"]
    assert values["DRIVEN"] == configs["Teleop!drive"]["topic"]
    assert re.findall(r'default_value="(live/\w+)"', text) == ["live/room"]
    assert "live_room.foxglove.json" in text
