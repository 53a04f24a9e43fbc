"""``python -m taichi_plume.envs``: the command of `taichi_plume.cli.envs`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("envs")
