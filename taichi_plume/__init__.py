"""Mobile-robot olfaction in one process: air flow, gas, robots, maps and a recording from one YAML file."""

import os

os.environ.setdefault(
    "ENABLE_TAICHI_HEADER_PRINT", "0"
)  # before the first import of taichi, here or elsewhere

__version__ = "0.1.0"
