"""Trained policies as agents, and those that come with the package: no torch, no pickle."""
