"""Films: a figure frame by frame into a GIF or, with ffmpeg, an MP4; the static parts are drawn once."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from matplotlib import animation
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from taichi_plume.files.disk import written_whole
from taichi_plume.guard.input_error import InputError

COLORS = 255  # colours of a GIF
Frame = TypeVar("Frame")


class NoFilmError(InputError):
    """Error: a film (GIF or MP4) cannot be written on this machine. The message begins with the film's path."""


class Still(FigureCanvasAgg):
    """Matplotlib canvas that draws static artists once, as a stored background, and moving artists in each frame."""

    def __init__(self, figure: Figure, moving: Sequence[Artist]):
        super().__init__(figure)
        self.background = None
        lowest = min(part.get_zorder() for part in moving)
        others = [part for part in moving[0].axes.get_children() if part not in moving]
        above = [part for part in others if part.get_zorder() > lowest]
        by_order = sorted(moving, key=Artist.get_zorder)
        self.drawn = sorted([*by_order, *above], key=Artist.get_zorder)
        for part in self.drawn:
            part.set_animated(True)

    def draw(self) -> None:
        """Draw the whole figure the first time; later restore the background and draw only moving artists and above."""
        if self.background is None:
            super().draw()
            self.background = self.copy_from_bbox(self.figure.bbox)
        self.restore_region(self.background)
        for part in self.drawn:
            self.figure.draw_artist(part)


def film(
    figure: Figure,
    moving: Sequence[Artist],
    path: Path,
    fps: int,
    frames: Sequence[Frame],
    show: Callable[[Frame], None],
) -> None:
    """Write a film of frames; `show` puts a frame on the figure. Raises NoFilmError and OSError."""
    if path.suffix.lower() != ".gif" and not animation.FFMpegWriter.isAvailable():
        raise NoFilmError(
            f"{path}: MP4 needs the program ffmpeg, which was not found; install ffmpeg, or use the ending .gif"
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


def _gif(canvas: Still, path: Path, fps: int, frames: Sequence[Frame], show: Callable[[Frame], None]) -> None:
    """Write a GIF with a single palette from three frames: faster and smaller than a palette per frame."""

    def drawn(frame: Frame) -> Image.Image:
        show(frame)
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())

    some = [np.asarray(drawn(frames[k * (len(frames) - 1) // 2])) for k in range(3)]
    palette = Image.fromarray(np.concatenate(some)).quantize(COLORS, dither=Image.Dither.NONE)
    images = (drawn(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    next(images).save(
        path, format="GIF", save_all=True, append_images=images, duration=max(20, round(1000 / fps)), loop=0
    )
