"""``python -m taichi_plume.report``: the command of `taichi_plume.cli.report`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("report")
