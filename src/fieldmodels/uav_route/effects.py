"""What may be missing from the nominal flight: the effects, in the order of ``simulation``'s rows."""

from __future__ import annotations

from fieldmodels.model import Effect, Parameter

EFFECTS = (
    Effect(
        "wind",
        "A steady wind blows: the aircraft crabs along its leg, faster or slower over ground.",
        "environment",
        (
            Parameter("north", "m/s", 0.0, -80.0, 80.0, 2.0),
            Parameter("east", "m/s", 0.0, -80.0, 80.0, 2.0),
        ),
        "ground speed = wind along + sqrt(speed^2 - wind across^2)",
    ),
    Effect(
        "turn_speed_loss",
        "The aircraft loses speed while it is banked in a turn.",
        "force",
        (Parameter("share", "1", 0.0, 0.0, 0.5, 0.02, starts=(0.1,)),),
        "speed * (1 - share) during T_turn",
    ),
    Effect(
        "weaker_bank",
        "The aircraft banks less in turns than it should, so that it takes longer to turn.",
        "actuator",
        (Parameter("factor", "1", 1.0, 0.2, 1.5, 0.02, starts=(0.8,)),),
        "bank = factor * 45 deg, in T_turn too",
    ),
    Effect(
        "sensor_bias",
        "The measured position is shifted by a constant.",
        "sensor",
        (
            Parameter("north", "m", 0.0, -5000.0, 5000.0, 50.0),
            Parameter("east", "m", 0.0, -5000.0, 5000.0, 50.0),
        ),
        "measured = position + bias",
    ),
)
"""All effects; their parameters in turn follow the speed in a parameter vector."""
