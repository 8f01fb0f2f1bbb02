"""Tables and figures of the sources, with ours beside them."""

from fieldagents.reproduce.run import ReproductionError, known_entry, reproduce, reproducible

__all__ = ["ReproductionError", "known_entry", "reproduce", "reproducible"]
