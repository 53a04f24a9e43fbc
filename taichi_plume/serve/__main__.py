"""``python -m taichi_plume.serve``: the command of `taichi_plume.cli.serve`."""

from taichi_plume.__main__ import end_by

if __name__ == "__main__":
    end_by("serve")
