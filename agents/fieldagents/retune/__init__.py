"""Agents designed anew in the simulation that has learned, and what that wins back in reality."""

from fieldagents.retune.after import Finish, finish, load_loop
from fieldagents.retune.loop import retune
from fieldagents.retune.report import show
from fieldagents.retune.result import Retuning
from fieldagents.retune.won_back import WonBack, won_back

__all__ = ["Finish", "Retuning", "WonBack", "finish", "load_loop", "retune", "show", "won_back"]
