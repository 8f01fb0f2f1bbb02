"""Plants: simulators in plain Python in which the exam hides faults, sharing no code with the models.

Each is written from the documented equations and integrates with fixed steps of its own; the oracles beside
them, slower and adaptive, check them. NumPy, SciPy and the standard library only.
"""
