"""``python -m taichi_plume.repair``: the command of `taichi_plume.cli.repair`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("repair")
