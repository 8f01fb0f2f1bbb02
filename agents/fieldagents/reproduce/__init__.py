"""Tables and figures of the sources, with ours beside them."""

from fieldagents.reproduce.run import ReproductionError, reproduce, reproducible

__all__ = ["ReproductionError", "reproduce", "reproducible"]
