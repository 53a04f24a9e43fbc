"""Films: a figure frame by frame into a GIF or, with ffmpeg, an MP4; what does not move is drawn once."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import animation
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from taichi_plume.files.disk import written_whole
from taichi_plume.guard.input_error import InputError

COLORS = 255  # of a GIF


class NoFilmError(InputError):
    """A film that cannot be made here; a line that begins with its path."""


class Still(FigureCanvasAgg):
    """A canvas that keeps the picture of all that stands still, and draws what moves on top of it."""

    def __init__(self, figure: Figure, moving: Sequence[Any]):
        super().__init__(figure)
        self.moving = sorted(moving, key=lambda one: one.get_zorder())
        self.behind: Any = None
        lowest = min(one.get_zorder() for one in moving)
        axes = moving[0].axes
        self.above = [one for one in axes.get_children() if one not in moving and one.get_zorder() > lowest]
        for one in [*self.moving, *self.above]:
            one.set_animated(True)

    def draw(self) -> None:
        """All of it the first time, then what moves and what lies on that."""
        if self.behind is None:
            super().draw()
            self.behind = self.copy_from_bbox(self.figure.bbox)
        self.restore_region(self.behind)
        for one in sorted([*self.moving, *self.above], key=lambda one: one.get_zorder()):
            self.figure.draw_artist(one)


def film(
    figure: Figure,
    moving: Sequence[Any],
    path: Path,
    fps: int,
    frames: Sequence[Any],
    show: Callable[[Any], None],
) -> None:
    """Write a film of frames, each put there by `show`. Raises NoFilmError and OSError."""
    if path.suffix.lower() != ".gif" and not animation.FFMpegWriter.isAvailable():
        raise NoFilmError(
            f"{path}: MP4 needs the program ffmpeg, which is not there; name it .gif, or install ffmpeg"
        )
    canvas = Still(figure, moving)
    with written_whole(path) as fresh:
        if path.suffix.lower() == ".gif":
            _gif(canvas, fresh, fps, frames, show)
            return
        options = ["-pix_fmt", "yuv420p", "-f", "mp4"]
        writer = animation.FFMpegWriter(fps=fps, codec="h264", extra_args=options)
        with writer.saving(figure, str(fresh), figure.dpi):
            for frame in frames:
                show(frame)
                writer.grab_frame()


def _gif(canvas: Still, path: Path, fps: int, frames: Sequence[Any], show: Callable[[Any], None]) -> None:
    """One palette for all frames, from three of them: quicker than one each, smaller, and colours stay the same."""

    def drawn(frame: Any) -> Image.Image:
        show(frame)
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())

    some = [np.asarray(drawn(frames[k * (len(frames) - 1) // 2])) for k in range(3)]
    palette = Image.fromarray(np.concatenate(some)).quantize(COLORS, dither=Image.Dither.NONE)
    images = (drawn(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    next(images).save(
        path, format="GIF", save_all=True, append_images=images, duration=max(20, round(1000 / fps)), loop=0
    )
