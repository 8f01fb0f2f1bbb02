"""Excitation: a mobile manipulator that shakes its vehicle to learn it."""

MODEL = "model:ExcitationModel"
