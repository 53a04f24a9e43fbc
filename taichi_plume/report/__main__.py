"""``python -m taichi_plume.report``: the command of `taichi_plume.api.report`."""

from taichi_plume.__main__ import end_by

if __name__ == "__main__":
    end_by("report")
