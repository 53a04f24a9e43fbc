"""``python -m taichi_plume.study``: the command of `taichi_plume.cli.study`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("study")
