"""The main job in a few minutes: agents compared, a recording diagnosed, one report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import agent_names
from fieldagents.evaluation.config import EvaluateConfig
from fieldagents.evaluation.evaluate import evaluate
from fieldagents.evaluation.report import lead, report_section
from fieldagents.progress import Report
from fieldagents.task import get_task
from fieldmodels import html
from fieldmodels.diagnosis import answer, diagnose
from fieldmodels.diagnosis.report import pictures, write_results
from fieldmodels.diagnosis.report import report_section as diagnosis_section
from fieldmodels.files import write_text
from fieldmodels.model import Model
from fieldmodels.recording import Recording
from fieldmodels.recording.datasets import DatasetError, get_dataset, open_recording
from fieldmodels.recording.files import load_recording
from fieldmodels.registry import get_model

TRAIN = "dfki_simple_pendulum/ddp"
TEST = "dfki_simple_pendulum/direct_collocation"
SHIPPED = Path(__file__).with_name("recordings")
"""A pendulum with dry friction, by a simulator that shares no code with ours (``docs/demo_recording.py``)."""
DATA = {
    True: "A real pendulum, measured:",
    False: "A pendulum simulated by another program (no real recording could be fetched):",
}
NEXT = (
    "Next: your own log             fieldgym diagnose your_log.csv --machine pendulum",
    "      a task for your trainer  gym.make('fieldgym:fieldgym/HeelStrike-v0')",
    "      all tasks and agents     fieldgym list",
)
SCENARIOS = {"collisions_with_memory": "ar1", "collisions_that_drift": "low_pass"}


@dataclass(frozen=True)
class Recordings:
    """A pendulum's recordings, and what they are.

    Attributes:
        train: The recording to learn from.
        test: A separate recording, on which the gain is measured.
        about: What they are, in a sentence for the report.
        real: Whether a real machine was measured.
    """

    train: Recording
    test: Recording
    about: str
    real: bool


@dataclass(frozen=True)
class Demo:
    """What a demo has written and found.

    Attributes:
        page: The self-contained ``report.html``.
        findings: What came out, in plain sentences.
    """

    page: Path
    findings: tuple[str, ...]


def run_demo(out: Path, progress: Report, episodes: int = 30) -> Demo:
    """Diagnose a pendulum, evaluate the agents of a task, and write one report.

    Args:
        out: Result folder; the evaluation and the diagnosis get folders of their own below it.
        progress: Called with what is being done and the part of the whole that is done.
        episodes: Episodes of every agent in every scenario.
    """
    pendulum = get_model("pendulum")
    progress("Looking for real data", 0.0)
    found_logs = find_recordings(pendulum)

    known = get_task("heel_strike").agents
    of_extras = {name for name, agent in known.items() if agent.extra}  # a newcomer waits, and may lack them
    config = EvaluateConfig(
        name="demo",
        task="heel_strike",
        environments={
            name: EnvironmentConfig(settings={"collision_kind": kind}) for name, kind in SCENARIOS.items()
        },
        agents=[name for name in agent_names("heel_strike") if name not in of_extras],
        baseline="ranger",
        episodes=episodes,
    )
    diagnosis = diagnose(
        pendulum, [found_logs.train], [found_logs.test], progress=_share(progress, 0.02, 0.45)
    )
    summary = evaluate(config, out / "heel_strike", _share(progress, 0.45, 0.95))
    progress("Writing the report", 0.95)
    drawn = pictures(diagnosis)
    write_results(diagnosis, out / "pendulum", drawn)
    found = f"{answer.headline(diagnosis)} {answer.by_how_much(diagnosis)}".strip()
    compared = lead(summary)
    body = "\n".join(
        [
            f'<div class="lead"><p><b>{DATA[found_logs.real]}</b> {html.text(found)} '
            '<a href="#diagnosis">More</a></p>'
            f'<p><b>Heel-strike estimators</b><br>{compared} <a href="#agents">More</a></p></div>',
            '<h2 id="diagnosis">1. Diagnosis: what does the simulation of this pendulum get wrong?</h2>',
            f"<p>{html.text(found_logs.about)}</p>",
            _below(diagnosis_section(diagnosis, drawn, "pendulum/figures")),
            '<h2 id="agents">2. Agents: a walking robot\'s heel-strike estimator</h2>',
            "<p>Each step of <code>fieldgym/HeelStrike-v0</code> is one stride: the agent chooses the "
            "estimator's gains under noise whose level it does not know. The score is the error in the "
            "foot's height at heel strike. All agents meet the same noise on the same episodes.</p>",
            html.figure(
                _picture,
                "The task as it is rendered: the leg, its traces and the strike errors.",
                name="task",
                beside=out,
            ),
            _below(report_section(summary, beside=out)),
            "<h2>Where things are</h2>",
            "<p>Beside this page: <code>heel_strike/</code> holds every episode (Parquet), the summary and "
            "the evaluation's own report; <code>pendulum/</code> holds <code>diagnosis.json</code>, its own "
            "report, and <code>extended.yaml</code>, the simulation that has learned.</p>",
        ]
    )
    report = out / "report.html"
    write_text(report, html.page("fieldgym demo", body))
    progress("Done", 1.0)
    return Demo(report, (f"{DATA[found_logs.real]} {found}", *html.plain(compared)))


def find_recordings(pendulum: Model) -> Recordings:
    """Real recordings where they can be had; else those that are shipped, of a simulated pendulum."""
    try:
        train, test = open_recording(TRAIN, pendulum), open_recording(TEST, pendulum)
    except DatasetError as error:
        train, test = (load_recording(SHIPPED / f"pendulum_{k}.csv", pendulum) for k in ("train", "test"))
        about = (
            f"No real recording could be had ({error}). Instead: a pendulum with dry friction of 0.15 N m, "
            "simulated by a program that shares no code with the model; the diagnosis knows nothing of it."
        )
        return Recordings(train, test, about, real=False)
    sources = [get_dataset(name) for name in (TRAIN, TEST)]
    about = (
        f"Real data: a torque-limited pendulum at DFKI RIC ({sources[0].licence}). Learned from: "
        f"{sources[0].about} ({sources[0].source}); tested on: {sources[1].about} ({sources[1].source})."
    )
    return Recordings(train, test, about, real=True)


def _picture(width: float) -> object:
    """A frame of the task, as a matplotlib figure."""
    import gymnasium as gym
    from matplotlib.figure import Figure

    import fieldgym  # noqa: F401  (registers the tasks)

    env = gym.make("fieldgym/HeelStrike-v0", render_mode="rgb_array")
    env.reset(seed=3)
    for _ in range(12):
        env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    frame = np.asarray(env.render())
    env.close()
    figure = Figure(figsize=(width, width * frame.shape[0] / frame.shape[1]), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(frame)
    axes.set_axis_off()
    return figure


def _below(section: str) -> str:
    """A report's body one level of headings deeper."""
    return section.replace("<h3", "<h4").replace("</h3", "</h4").replace("<h2", "<h3").replace("</h2", "</h3")


def _share(progress: Report, start: float, end: float) -> Callable[[str, float], None]:
    """Report a part's progress as a stretch of the whole."""
    return lambda stage, part: progress(stage, start + (end - start) * part)
