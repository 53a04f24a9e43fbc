"""``python -m taichi_plume.envs``: the command of `taichi_plume.cli.envs`."""

from taichi_plume.__main__ import end_by

if __name__ == "__main__":
    end_by("envs")
