"""Robots: bodies, sensors, search algorithms and maps. They see the world only through sensors."""
