"""``python -m taichi_plume.scenario``: the command of `taichi_plume.cli.scenario`."""

from taichi_plume.__main__ import end_by

if __name__ == "__main__":
    end_by("scenario")
