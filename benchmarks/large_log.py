"""A log of 183 MB, from the file to the verdict: processor seconds and memory of ``fieldgym diagnose``.

    python benchmarks/large_log.py

The log is a pendulum with dry friction at 1 kHz, as text; kernels are compiled before the clock starts.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from fieldmodels.recording.files import save_recording
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

EPISODES, SECONDS, STEP = 13, 200.0, 0.001


def diagnosed(log: Path, out: Path) -> tuple[float, float, float, str]:
    """Seconds, processor seconds, peak memory of all so far [GB], and what the command says first."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [str(Path(sys.executable).with_name("fieldgym")), "diagnose", str(log), "--machine", "pendulum"]
    done = subprocess.run([*command, "--out", str(out)], capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return (
        time.perf_counter() - began,
        spent,
        1e-6 * after.ru_maxrss,
        next(s for s in done.stdout.splitlines() if s.strip()),
    )


def main() -> None:
    """Write the logs, diagnose them, print the figures."""
    pendulum, hidden = get_model("pendulum"), {"coulomb_friction": {"torque": 0.1}}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for seconds, episodes in ((20.0, 1), (SECONDS, EPISODES)):
            made = synthesise(
                pendulum, hidden, "mixed", duration=seconds, step=STEP, episodes=episodes, amplitude=1.0,
                refine=2, rng=np.random.default_rng(0),
            )  # fmt: skip
            log = folder / f"{episodes}.csv"
            save_recording(made, log)
            wall, spent, memory, verdict = diagnosed(log, folder / f"out{episodes}")
            size = log.stat().st_size / 1e6
            said = f"{spent:.1f} processor s, {wall:.1f} s, {memory:.1f} GB; {verdict}"
            print(f"{size:.1f} MB, {len(made):,} rows: {said}")


if __name__ == "__main__":
    main()
