"""A machine's step, composed of its own equations and the stock effects, and the loops that run it."""
