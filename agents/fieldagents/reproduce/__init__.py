"""Tables and figures of the sources, with ours beside them."""

from fieldagents.reproduce.entries import ENTRIES, Entry, Reproduction, ReproductionError, reproduce

__all__ = ["ENTRIES", "Entry", "Reproduction", "ReproductionError", "reproduce"]
