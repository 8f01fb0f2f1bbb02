"""Pose reaching: its agents, tuners and measures."""
