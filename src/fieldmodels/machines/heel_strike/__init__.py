"""Heel strike: a walking robot's state estimator and the world that it is tested in."""

MODEL = "model:HeelStrikeModel"
