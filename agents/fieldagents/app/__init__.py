"""A page on this machine alone: drop a log, see its signals, have it diagnosed, take the answer away."""
