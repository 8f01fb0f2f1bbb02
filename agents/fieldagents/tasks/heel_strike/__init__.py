"""Heel strike: its agents, tuners and measures."""
