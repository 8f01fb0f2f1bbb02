"""A chamber whose wall stores heat: a state with an effect that is off at 0."""

import fieldgym as fg

WALL = fg.Effect(
    "wall",
    "The wall stores heat.",
    "environment",
    (
        fg.Parameter("conductance", "W/K", 0.0, 0.0, 1e3, 5.0, starts=(5.0, 20.0)),
        fg.Parameter("capacity", "J/K", 3e4, 1e3, 1e6, 1e4),
    ),
)


class Chamber(fg.Machine):
    """Temperature of the air in a chamber."""

    inputs = (fg.Signal("heat", "W"), fg.Signal("ambient", "°C"))
    states = (fg.Signal("air", "°C"), fg.Signal("wall", "°C"))
    outputs = (fg.Signal("air", "°C", noise=0.05),)
    capacity = fg.number("J/K", 12e3, 1e3, 1e6)
    loss = fg.number("W/K", 10.0, 0.1, 1e3)
    effects = (*fg.effects.actuator("heat"), *fg.effects.sensor("air"), WALL)

    def derivative(self, state, input, p):
        """Rates of air and wall."""
        through = p.wall_conductance * (state.air - state.wall)
        lost = p.loss * (state.air - input.ambient)
        return (input.heat - lost - through) / p.capacity, through / p.wall_capacity

    def initial_states(self, recording, starts):
        """The wall starts as warm as the air."""
        states = super().initial_states(recording, starts)
        states[:, 1] = states[:, 0]
        return states
