"""``python -m taichi_plume.run``: the command of `taichi_plume.cli.run`."""

from taichi_plume.__main__ import end_by

if __name__ == "__main__":
    end_by("run")
