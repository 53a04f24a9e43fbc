"""Version of the package, which every file of a run states."""

__version__ = "0.2.0.dev0"
