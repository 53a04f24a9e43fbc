"""Gas and wind in the recording: a slice above the floor, in 3-D a volume, and arrows."""

from math import ceil

import numpy as np
import rerun as rr

from taichi_plume.grid import fields
from taichi_plume.record import drawing, scene
from taichi_plume.record.stream import Stream
from taichi_plume.simulation import Simulation

MOST_PIXELS = 400  # per axis of the slice
MOST_VOXELS = 96  # per axis of the volume


class Pictures:
    """Draws gas and wind picture by picture. top_speed: wind whose arrows have their full length [m/s]."""

    def __init__(self, stream: Stream, sim: Simulation, stage: scene.Stage, top_speed: float):
        self.stream, self.stage, self.top_speed = stream, stage, top_speed
        grid, recording = sim.grid, sim.scenario.recording
        self.range_ppm = recording.range_ppm
        pixel = grid.dx * ceil(max(grid.shape[:2]) / MOST_PIXELS)
        pixels = tuple(max(1, round(length / pixel)) for length in grid.extent[:2])
        self.slice_points = drawing.lattice([n * pixel for n in pixels], pixels)
        if grid.dim == 3:
            height = np.full((*pixels, 1), min(recording.slice_height, grid.extent[2]))
            self.slice_points = np.concatenate([self.slice_points, height], axis=-1)
        picture = rr.GridMap.from_fields(
            format=scene.picture_format(*pixels, color=False),
            cell_size=pixel,
            translation=[0, 0, stage.lift],
            colormap="inferno",
            opacity=0.95,
        )
        stream.log_still(iter([("gas/slice", picture)]))
        self.volume_points = None
        if grid.dim == 3 and recording.volume:
            counts = [min(ceil(n / 2), MOST_VOXELS) for n in grid.shape]
            self.volume_points = drawing.lattice(grid.extent, counts)
            self.voxel = [length / n for length, n in zip(grid.extent, counts, strict=True)]
        height = min(recording.slice_height, grid.extent[-1])
        self.arrow_points, self.arrow_step = drawing.arrow_places(grid.extent, height)

    def show_gas(self, sim: Simulation) -> None:
        """The slice above the floor and, in 3-D, the volume."""
        image = (255 * self._gas(sim, self.slice_points)).round().astype(np.uint8)
        self.stream.log(sim.t, "gas/slice", rr.GridMap.from_fields(data=drawing.rows(image)))
        if self.volume_points is not None:
            values = (self._gas(sim, self.volume_points) * 255).round() / 255  # fewer values pack better
            volume = rr.Volume3D(
                np.ascontiguousarray(values.transpose(2, 1, 0), np.float16),
                voxel_size=self.voxel,
                value_range=[0.0, 1.0],
                gamma=2.0,
                optical_density=3.0 / self.stage.height,
                colormap="inferno",
            )
            self.stream.log(sim.t, "gas/volume", volume)

    def _gas(self, sim: Simulation, points: np.ndarray) -> np.ndarray:
        """Place on the colour scale of the gas at some points."""
        ppm = fields.ppm_at(sim.gas, points, sim.t).sum(axis=-1)
        return np.nan_to_num(drawing.logarithmic(ppm, *self.range_ppm))

    def show_wind(self, sim: Simulation) -> None:
        """Arrows centred on their points."""
        velocity = fields.velocity_at(sim.wind, self.arrow_points, sim.t)
        speed = np.linalg.norm(velocity, axis=-1)
        share = np.sqrt(np.minimum(speed / self.top_speed, 1.0))
        seen = (share > 0.05) & np.isfinite(speed)
        direction = velocity[seen] / speed[seen, None]
        vectors = np.zeros((seen.sum(), 3))
        origins = np.full((seen.sum(), 3), 6 * self.stage.lift)
        vectors[:, : velocity.shape[1]] = direction * (0.95 * self.arrow_step * share[seen])[:, None]
        origins[:, : velocity.shape[1]] = self.arrow_points[seen]
        alpha = 60 + 150 * share[seen]
        colors = np.column_stack([np.full((len(alpha), 3), 230), alpha]).astype(np.uint8)
        arrows = rr.Arrows3D(
            origins=origins - vectors / 2, vectors=vectors, colors=colors, radii=0.055 * self.arrow_step
        )
        self.stream.log(sim.t, "wind", arrows)
