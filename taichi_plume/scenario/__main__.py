"""``python -m taichi_plume.scenario``: the command of `taichi_plume.cli.scenario`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("scenario")
