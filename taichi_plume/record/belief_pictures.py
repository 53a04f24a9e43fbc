"""What robots believe of the source's place, in the recording: of each group the first robot of the first trial."""

import numpy as np
import rerun as rr

from taichi_plume.record import drawing
from taichi_plume.record.stage import Stage, picture_format
from taichi_plume.record.stream import Stream
from taichi_plume.scoring.beliefs import beliefs
from taichi_plume.simulation import Simulation


class BeliefPictures:
    """Draws the beliefs of a run, as densities [1/m²]."""

    STATE = ()

    def __init__(self, stream: Stream, sim: Simulation, stage: Stage):
        self.stream = stream
        self.colors = drawing.painted(np.arange(256) / 255, drawing.EMBER)
        for one in beliefs(sim):
            blank = rr.GridMap.from_fields(
                format=picture_format(*one.p.shape[2:], color=True),
                cell_size=one.cell,
                translation=[*one.low, stage.lift],
            )
            stream.log_still(iter([(f"beliefs/{one.group.number}", blank)]))

    def show(self, sim: Simulation) -> None:
        """What they believe now."""
        for one in beliefs(sim):
            density = one.p[0, 0] / one.cell**2
            colors = self.colors[drawing.DENSITIES.bytes(density)]
            self.stream.picture(sim.t, f"beliefs/{one.group.number}", drawing.rows(colors))
