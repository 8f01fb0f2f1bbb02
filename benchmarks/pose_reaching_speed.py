"""Speed of the pose-reaching environment beside Gymnasium's own CartPole, as ratios within one run.

python benchmarks/pose_reaching_speed.py

Both are stepped with actions drawn beforehand, episodes restart as they end, and all that a step returns is
made (observation, reward, flags, info). Rounds alternate between the two, and each round's processor time
is taken; printed are the fastest round of each and the ratio of the two.
"""

from __future__ import annotations

from steppers import native, scalar, steps_a_second

OURS, THEIRS = "fieldgym/PoseReaching-v0", "CartPole-v1"
FAULTS = {"actuator_lag": {"time_constant": 0.1}, "sensor_delay": {"delay": 0.1}}


def main() -> None:
    """Print the table."""
    print(f"{'million steps/s':28s}{'pose reaching':>16s}{'CartPole':>12s}{'ratio':>8s}{'with faults':>14s}")
    for count in (1, 64, 1024):
        ours, theirs, faulty = steps_a_second(
            {
                "ours": (native(OURS, count), count),
                "theirs": (native(THEIRS, count), count),
                "faulty": (native(OURS, count, reality=FAULTS), count),
            }
        ).values()
        label = f"native vector, {count}"
        print(f"{label:28s}{ours / 1e6:16.3f}{theirs / 1e6:12.3f}{ours / theirs:8.2f}{faulty / 1e6:14.3f}")
    ours, theirs = steps_a_second({"ours": (scalar(OURS), 1), "theirs": (scalar(THEIRS), 1)}).values()
    print(f"{'scalar, gym.make':28s}{ours / 1e6:16.3f}{theirs / 1e6:12.3f}{ours / theirs:8.2f}")


if __name__ == "__main__":
    main()
