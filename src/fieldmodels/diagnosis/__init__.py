"""What is wrong (misfit), refit with each candidate (fit), name it (selection), measure (gain), report."""
