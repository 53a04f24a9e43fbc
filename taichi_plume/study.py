"""``python -m taichi_plume.study``: the command of `taichi_plume.cli.study`."""

from taichi_plume.__main__ import end_by

if __name__ == "__main__":
    end_by("study")
elif __name__ != "__mp_main__":  # of a child process of the command
    raise ImportError("taichi_plume.study is a function: import taichi_plume as tp; tp.study(...)")
