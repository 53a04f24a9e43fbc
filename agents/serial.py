"""Serial loops: whether a loop over robots is worth a second thread."""

from taichi_plume.grid.kernels import on_cpu

FEW = 2000  # robots; waking a thread takes 0.1 ms, for which one does 1,500 to 4,000 robots


def runs_serially(robots: int) -> bool:
    """Return whether the caller's thread alone finishes a loop over so many robots sooner."""
    return on_cpu() and robots <= FEW
