"""Mobile-robot olfaction in one process: air flow, gas, robots, maps and a recording from one YAML file."""

__version__ = "0.1.0"
