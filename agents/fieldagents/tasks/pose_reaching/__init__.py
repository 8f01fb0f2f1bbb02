"""Pose reaching: its agents, tuners, figures and measures."""
