"""Plants: simulators in plain Python in which the exam hides faults, sharing no code with the models.

Each is written from the documented equations and integrates with fixed steps of its own; ``tests/plants``
compares every listed effect of every model with them, by finer steps. NumPy, SciPy, standard library only.
"""
