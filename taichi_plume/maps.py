"""``python -m taichi_plume.maps``: the command of `taichi_plume.cli.maps`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("maps")
elif __name__ != "__mp_main__":  # of a child process of the command
    raise ImportError("taichi_plume.maps is a function: import taichi_plume as tp; tp.maps(...)")
