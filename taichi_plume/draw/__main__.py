"""Command `python -m taichi_plume.draw`; see taichi_plume.cli.draw."""

from taichi_plume.__main__ import command

if __name__ == "__main__":
    command("draw")
