"""Command `python -m taichi_plume.draw`; see taichi_plume.cli.draw."""

from taichi_plume.__main__ import end_by

if __name__ == "__main__":
    end_by("draw")
