"""``python -m taichi_plume.statistics``: the command of `taichi_plume.cli.statistics`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("statistics")
