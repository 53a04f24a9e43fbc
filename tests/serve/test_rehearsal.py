"""Kernels of a served run: all are compiled before its clock starts."""

from math import inf

import pytest

from taichi_plume.assembly.preparation import load
from taichi_plume.engine.program import compiled
from taichi_plume.execution.execute import Job, inputs_of, run
from taichi_plume.files.run_folder import RunFolder
from taichi_plume.serve.service import Pace, Service

pytest.importorskip("rosbags")
pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SCENARIO = """
name: rehearsed
duration: 6 s
stop_early: false
domain: {size: [1.6, 1.2, 0.6], spacing: 0.1}
wind:
  kind: cfd
  openings: [{kind: inlet, face: x-, speed: 0.3}, {kind: outlet, face: x+}]
gas: {kind: eulerian, sources: [{position: [0.3, 0.6, 0.3], rate: 20 mg/s, radius: 10 cm}]}
robots:
  - name: remote
    count: 1
    start: {kind: positions, positions: [[1.2, 0.4]]}
    algorithm: {kind: external}
    wake: true
    sensors:
      gas: {kind: mox, model: tgs2620, height: 0.2}
      wind: {kind: ultrasonic, height: 0.2}
  - name: seekers
    count: 1
    start: {kind: positions, positions: [[1.3, 0.9]]}
    algorithm: {kind: particle_filter}
maps: [{kind: kernel_dmv, cell: 0.2}, {kind: gmrf, cell: 0.2}, {kind: time_series, cell: 0.2, window: 1}]
fields: {rate: 1}
"""


class Counting(Service):
    """Service that notes the number of compiled kernels at the start of every tick of the clock."""

    def keep_time(self) -> None:
        super().keep_time()
        self.counts = [*getattr(self, "counts", []), compiled()]


def test_nothing_is_compiled_after_the_clock_has_started(tmp_path):
    """With a computed wind, a wake, maps of all windows, an algorithm with periods, films and a recording."""
    (tmp_path / "s.yaml").write_text(SCENARIO)
    prepared, service = load(tmp_path / "s.yaml"), Counting(Pace(inf, at_once=True), [], quiet=True)
    with RunFolder("rehearsed", tmp_path / "out", False, inputs=inputs_of(prepared)) as folder:
        run(Job(prepared, folder, "cpu", "cpu", report=False, service=service, progress=False))
    assert len(service.counts) == 61
    assert service.counts == [service.counts[0]] * 61
    assert service.counts[0] > 10
