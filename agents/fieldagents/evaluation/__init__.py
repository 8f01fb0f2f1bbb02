"""Scoring agents on fixed episodes, with paired differences and intervals."""
