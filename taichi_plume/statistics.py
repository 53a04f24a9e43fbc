"""``python -m taichi_plume.statistics``: the command of `taichi_plume.cli.statistics`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("statistics")
elif __name__ != "__mp_main__":  # of a child process of the command
    raise ImportError("taichi_plume.statistics is a function: import taichi_plume as tp; tp.statistics(...)")
