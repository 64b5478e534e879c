"""Inspection of a recording without a description: its series, its faults, and a log.toml to start from."""
