"""Learned policies: training, export, and running them without torch."""
