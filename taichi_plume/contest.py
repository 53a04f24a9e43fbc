"""``python -m taichi_plume.contest``: the command of `taichi_plume.cli.contest`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("contest")
elif __name__ != "__mp_main__":  # of a child process of the command
    raise ImportError("taichi_plume.contest is a function: import taichi_plume as tp; tp.contest(...)")
