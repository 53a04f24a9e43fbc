"""``python -m taichi_plume.maps``: the command of `taichi_plume.cli.maps`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("maps")
