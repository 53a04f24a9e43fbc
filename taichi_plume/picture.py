"""``python -m taichi_plume.picture``: the command of `taichi_plume.cli.picture`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("picture")
