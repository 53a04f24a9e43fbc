"""Declarations in a recording: a mark at its place from its time on, right or wrong, and an event."""

from pathlib import Path

import fake_run
import numpy as np
import pytest
from recordings import column, entities, record, recorded

from taichi_plume.grid.state import State
from taichi_plume.scenario import palette
from taichi_plume.scenario.palette import rgb

pytestmark = pytest.mark.usefixtures("taichi")

SAYS = [(2.0, (1.0, 2.0), False), (4.0, (0.7, 1.5), True), (5.0, (3.0, 3.0), False)]
"""Time, place and truth of what the second robot says."""


def simulation(**changes):
    team = fake_run.scenario(2).robots[0].model_dump(mode="json") | {"algorithm": {"kind": "own"}}
    model = fake_run.scenario(2, duration=6, maps=[], **{"robots": [team], **changes})
    sim = fake_run.simulation(model)
    sim.swarm.says = SAYS
    return sim


def marks(path: Path) -> list[tuple[float, list, int]]:
    """Times, middles and colours of the marks of the second robot."""
    t, strips = column(path, "/declared/team-1", "LineStrips3D:strips")
    _, colors = column(path, "/declared/team-1", "LineStrips3D:colors")
    return [
        (time, np.array(one[1]).mean(axis=0)[:2].tolist(), color[0])
        for time, one, color in zip(t.tolist(), strips, colors, strict=True)
    ]


def packed(color: tuple[int, int, int]) -> int:
    return (color[0] << 24) + (color[1] << 16) + (color[2] << 8) + 255


WANTED = [
    (2.0, pytest.approx([1.0, 2.0]), packed(rgb(palette.WRONG))),
    (4.0, pytest.approx([0.7, 1.5]), packed(rgb(palette.FOUND))),
]


def test_marks_and_events(tmp_path):
    path = recorded(simulation(), tmp_path / "a.rrd")
    assert marks(path) == WANTED
    t, texts = column(path, "/events", "TextLog:text")
    reported = {round(time, 6): text[0] for time, text in zip(t, texts, strict=True) if "declared" in text[0]}
    assert reported == {
        2.0: "team-1 declared a source at (1.00, 2.00) m, falsely",
        4.0: "team-1 declared a source at (0.70, 1.50) m, rightly",
        5.0: "team-1 declared again, falsely; its first right place counts",
    }


def test_a_resumed_recording_has_them_once(tmp_path):
    sim = simulation()
    recorder = record(sim, tmp_path / "a.rrd")
    sim.observe()
    while sim.t < 3.0:
        sim.advance()
        sim.observe()
    recorder.flush()
    saved = State(recorder.tracks).save()
    recorder.close()
    assert marks(tmp_path / "a.rrd") == WANTED[:1]
    again = simulation()
    later = record(again, tmp_path / "b.rrd")
    State(later.tracks).restore(saved)
    while again.t < 3.0:
        again.advance()
    again.run()
    later.close()
    assert marks(tmp_path / "b.rrd") == WANTED[1:]


def test_who_never_declares_leaves_no_trace(tmp_path):
    path = recorded(fake_run.simulation(fake_run.scenario(2, duration=1, maps=[])), tmp_path / "a.rrd")
    assert not [one for one in entities(path) if "declared" in one]
