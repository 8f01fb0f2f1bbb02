"""Excitation: its agents, tuners, figures and measures."""
