"""``python -m taichi_plume.export``: the command of `taichi_plume.cli.export`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("export")
