"""Processes that advance fields: air flow and gas."""
