"""Serial or parallel loops: decision whether a loop over robots is worth a second thread."""

from taichi_plume.engine.fields import on_cpu

SERIAL = 2000  # robots; waking a thread takes 0.1 ms, the time for 1,500 to 4,000 robots in a thread


def runs_serially(robots: int) -> bool:
    """Return whether a loop over this number of robots finishes sooner on one CPU thread than on several."""
    return on_cpu() and robots <= SERIAL
