"""Measured data from a simulated reality, as a bench or a robot would deliver them."""

from fieldagents.record.config import RecordConfig
from fieldagents.record.make import make_recording, record

__all__ = ["RecordConfig", "make_recording", "record"]
