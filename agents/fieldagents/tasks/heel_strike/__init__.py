"""Heel strike: its agents, tuners, figures and measures."""
