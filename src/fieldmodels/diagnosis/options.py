"""What a diagnosis asks of the data before it says something."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scipy import special


@dataclass(frozen=True)
class DiagnosisOptions:
    """The thresholds of a diagnosis, each with its evidence.

    Attributes:
        level: p-value of a paired test over blocks of windows below which a gain counts as significant.
        curve_level: The same for the best of all unlisted curves, which must also bring the logarithm of
            their number over it: of 30 clean records of rig and pendulum the best curve brought 8.9 nats at
            p = 0.0085 in one, else 7.6 at most.
        least_gain: Held-out likelihood [nats] that an effect or a curve must bring, after its price. Eight is
            the logarithm of some thirty candidates over the level; the best of 54 curves beside a right
            model brought 5.2 at most in eight records.
        least_share: The same as a share of the whole loss, so that long records name nothing negligible.
        price: Nats for each parameter, on top of what it costs on held-out windows (Akaike's price is 1).
        price_of_name: Nats that every name after the first must bring against unlisted curves: a set of
            listed effects can imitate one curve (a bilinear spring was named constant force and cogging, a
            quadratic actuator asymmetry and constant force).
        same_gain: Two sets are told apart by more than so many nats, or
        same_p: by less if the difference is steady over the blocks: the p-value below which it is. By less
            than ``undecided`` they are not: near-equivalent effects differ little, but always.
        beaten_by: Nats by which a curve must beat what is named to take its place.
        beaten_p: p-value of the paired test over blocks that it does, from which on it may.
        above: Times a sensor's white noise. If the first output's error stays above it and the names do not
            explain most of that error, they are only possible. If nothing is named, something is missing if a
            curve of the motion brings what it must at
        likely_p: this p-value (curves of a sensor and of time fit its coloured noise), or if the error is
        far: so many times the white noise. Pink noise, no fault of the machine, reached 3.5 in pendulums and
            4.9 in a robot's heading over 2 s, its best curve of the motion p = 0.12; a pendulum moved by hand
            reaches 75, a bang-bang swing-up 3.3 with p = 0.06.
        most: Share of what a curve explains that a name must explain to stay beside a curve of the rest:
            wrong names of a cubic and of a lagging sensor explained 0.6 of it.
        most_causes: Effects in a set.
        most_curves: Curves beside each other.
        threads: How many share the fits of candidates, with the same result to the bit; 0 for as many as the
            environment variable ``FIELDGYM_THREADS`` says, else one. They pay where a simulation takes a
            millisecond or more.
        engine: "evidence" searches names and curves alike by their marginal likelihood, on trial; "rules" is
            the one that has been examined.
        unexplained_ratio: Times a sensor's white noise. While the error stays above it, names and curves are
            as probable as the share of it that they explain, at most; asked by the search by evidence.
        rows: Samples of the windows that are fitted, a thousand windows of 0.3 s at 100 Hz, a hundred at
            1 kHz; of a longer record those that tell most. Millions of samples are diagnosed in a minute.
    """

    level: float = 0.01
    curve_level: float = 0.005
    least_gain: float = 8.0
    least_share: float = 0.003
    price: float = 1.0
    price_of_name: float = 10.0
    same_gain: float = 6.0
    same_p: float = 0.05
    beaten_by: float = 3.0
    beaten_p: float = 0.1
    above: float = 3.0
    likely_p: float = 0.1
    far: float = 6.0
    most: float = 0.75
    most_causes: int = 4
    most_curves: int = 2
    threads: int = 0
    unexplained_ratio: float = 1.7
    rows: int = 30_000
    engine: Literal["rules", "evidence"] = "rules"

    @property
    def undecided(self) -> float:
        """Nats by which the wrong one of two sets leads in no more than ``level`` of records, 2.7 of 0.01.

        A lead is normal, its variance twice its mean: the wrong one's tail is largest where that is as large.
        """
        return 0.5 * float(special.ndtri(self.level)) ** 2


DEFAULT = DiagnosisOptions()
