"""Line following's agents on images, through the camera board's firmware."""

from __future__ import annotations

from fieldagents.tasks.line_following import agents

AGENTS = tuple(agent for agent in agents.AGENTS if agent.name != "two_bands")
"""In the order of presentation; one band of pixels is all that the firmware reads."""
