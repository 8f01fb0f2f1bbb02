"""Pose reaching: the claims of its source, and its tables and figures redone."""
