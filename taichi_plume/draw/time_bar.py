"""Time of a page: a slider and a button to play, for a run that goes on or has ended."""

from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.layouts import row
from bokeh.models import Button, Div, Slider

from taichi_plume.execution.latest_instant import Instant

if TYPE_CHECKING:
    from taichi_plume.draw.page import Page
    from taichi_plume.draw.runs import Run

TICK = 100  # ms between two moments that are played
LENGTH = 20.0  # s, about, of a run that is played from begin to end
MOST_STEPS = 500  # of the slider
LATEST, PLAY, PAUSE = "latest", "▶ play", "❚❚ pause"


class TimeBar:
    """Choice of the moment of a run that the views show. t: simulated time [s]; None: the run's latest."""

    def __init__(self, page: "Page"):
        self.page, self.t = page, None
        self._playing: Any = None
        self._setting = False
        self.slider = Slider(
            start=0,
            end=1,
            value=0,
            step=0.1,
            title="t [s]",
            format="0.0",
            name="time",
            sizing_mode="stretch_width",
        )
        self.slider.on_change("value", lambda _attr, _old, new: self._moved(float(new)))
        self.play = Button(label=PLAY, width=90, name="play", align="end")
        self.play.on_click(self._play)
        self.latest = Button(label=LATEST, width=90, name="latest", align="end")
        self.latest.on_click(lambda: self.choose(None))
        self.about = Div(name="clock", width=190, align="end", css_classes=["faint"])
        self.layout = row(
            self.play, self.slider, self.latest, self.about, visible=False, sizing_mode="stretch_width"
        )

    def choose(self, t: float | None) -> None:
        """Show a moment [s] of the run, or, by None, its latest."""
        if t is None:
            self._pause()
        self.t = t
        self.page.look()

    def _moved(self, t: float) -> None:
        if not self._setting:
            self.choose(t)

    def show(self, run: "Run | None", seen: Instant | None) -> None:
        """Show the recorded times of a run, and the moment that is seen."""
        begin, end = run.recorded if run is not None else (0.0, 0.0)
        self.layout.visible = end > begin
        if not self.layout.visible:
            return
        now = seen.t if seen is not None else end
        self._setting = True
        self.slider.update(
            start=begin, end=end, step=(end - begin) / MOST_STEPS, value=min(max(now, begin), end)
        )
        self._setting = False
        self.latest.disabled = self.t is None
        wind = seen.wind(self.page.runs.picture) if seen is not None else np.empty((4, 0))
        fastest = float(np.hypot(*wind[2:]).max(initial=0.0))
        self.about.text = f"longest line: {fastest:.2g} m/s" if fastest > 0 else ""

    # ---------------------------------------------------------------- play

    def _play(self) -> None:
        run = self.page.runs.run
        if self._playing is not None or run is None:
            self._pause()
            return
        begin, end = run.recorded
        if self.t is None or self.t >= end:
            self.t = begin
        self.play.label = PAUSE
        self._playing = self.page.document.add_periodic_callback(self.forward, TICK)

    def _pause(self) -> None:
        if self._playing is not None:
            self.page.document.remove_periodic_callback(self._playing)
        self._playing, self.play.label = None, PLAY

    def forward(self) -> None:
        """Show the next of the moments that are played; pause at the last."""
        run = self.page.runs.run
        if run is None:
            self._pause()
            return
        begin, end = run.recorded
        t = (self.t if self.t is not None else begin) + (end - begin) * TICK / 1e3 / LENGTH
        if t >= end:
            self._pause()
        self.choose(min(t, end))
