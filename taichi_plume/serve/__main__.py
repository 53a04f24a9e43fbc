"""``python -m taichi_plume.serve``: the command of `taichi_plume.cli.serve`."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("serve")
