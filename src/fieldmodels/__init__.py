"""The world, and what measured data say about it: models, estimators, recordings, diagnosis."""
