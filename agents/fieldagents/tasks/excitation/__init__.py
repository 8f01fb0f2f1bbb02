"""Excitation: its agents, tuners and measures."""
