"""``python -m taichi_plume.examples``: the command of `taichi_plume.cli.examples`; names and files of the examples."""

from taichi_plume.__main__ import command
from taichi_plume.files.bundled import names, path_of

__all__ = ["names", "path_of"]

if __name__ == "__main__":
    command("examples")
