"""``python -m taichi_plume.contest``: the command of `taichi_plume.cli.contest`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("contest")
