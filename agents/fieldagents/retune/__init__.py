"""Agents tuned anew in the extended simulation, and how much of the loss that recovers in reality."""

from fieldagents.retune.after import Finish, finish, load_loop
from fieldagents.retune.loop import retune
from fieldagents.retune.recovery import Recovery, recovery
from fieldagents.retune.report import show
from fieldagents.retune.result import Retuning

__all__ = ["Finish", "Recovery", "Retuning", "finish", "load_loop", "recovery", "retune", "show"]
