"""The command `fieldgym`: thin, so that each command is one call of a function that scripts can use too."""

from __future__ import annotations

import errno
import io
import sys
import threading
import warnings
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from fieldagents import checkout, completion
from fieldagents.console import (
    RESOURCES,
    Address,
    DryRun,
    EngineName,
    Json,
    Workers,
    announce,
    begin,
    claim_folder,
    print_files,
    print_json,
    print_message,
    print_result,
)
from fieldagents.progress import progress
from fieldagents.seeds import LARGEST_SEED
from fieldmodels.engine.stopping import interruptible
from fieldmodels.extras import words

if TYPE_CHECKING:
    from rich.console import Console

    from fieldmodels.engine import Engine

DISK = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS, errno.EFBIG)
"""Errors of a disk, whoever met them."""
OURS = ("fieldmodels", "fieldgym", "fieldagents", "exam", "papers")


class _Commands(TyperGroup):
    """Turns a mistake of the user into one clear message and exit code 2; a bug keeps its traceback."""

    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override]
        with warnings.catch_warnings(), ExitStack() as held:
            warnings.showwarning = _show_warning
            RESOURCES.set(held)
            held.callback(setattr, threading, "excepthook", threading.excepthook)
            threading.excepthook = _thread_failed

            def leave() -> None:
                print_message(
                    "Stopped within a long step; files are whole, and what the command keeps serves again."
                )
                held.close()

            try:
                with interruptible(leave):
                    return super().invoke(ctx)
            except KeyboardInterrupt as stop:
                print_message(": ".join(["Stopped", *map(str, stop.args)]))
                raise typer.Exit(130) from None
            except Exception as error:
                message = _message(error)
                if message is None:
                    raise
                _fail(message, getattr(error, "exit_code", 2))


def _thread_failed(failed: threading.ExceptHookArgs) -> None:
    """What a thread of a library meets, such as a full disk, is said as any other; who waits for it ends."""
    message = _message(failed.exc_value) if isinstance(failed.exc_value, Exception) else None
    if message is None:
        threading.__excepthook__(failed)
    else:
        print_message(f"Warning: {message}")


def _message(error: Exception) -> str | None:
    """What to say to the user, or None for an error that is not the user's."""
    from fieldagents.config import ConfigError

    if isinstance(error, ConfigError) and len(error.problems) > 1:
        return "\n".join([f"{len(error.problems)} mistakes:", *error.problems])
    if isinstance(error, ModuleNotFoundError):
        return words(error) or None
    if type(error).__module__.split(".")[0] in OURS:
        return str(error)
    if isinstance(error, OSError) and (error.filename is not None or error.errno in DISK):
        return f"{error.filename or 'writing'}: {error.strerror}"
    return None


def _fail(message: str, code: int) -> None:
    print_message("Error: " + "\n  ".join(message.splitlines()))
    raise typer.Exit(code)


def _show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    if not issubclass(category, DeprecationWarning | PendingDeprecationWarning | ImportWarning):
        print_message(f"Warning: {message}")


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="""Field-robot problems as Gymnasium environments, the published algorithms as reference agents,
learned agents trained from configs, and a diagnosis that finds from measured data what a simulation
gets wrong.

Start with **fieldgym list**, or with **fieldgym demo** for everything in a few minutes.
Every command takes **--json**: the result alone on standard output, progress on standard error.
""",
    epilog="Exit codes: 0 done, 1 jobs, cases or claims failed, or a fault of the program, "
    "2 a mistake in what it was given, 130 stopped.",
)

Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a key of the config, as in `--set a.b=1e-3`."),
]


_CONFIG = "YAML file, or the name of a shipped one: `heel_strike/ppo`."
ConfigPath = Annotated[
    Path,
    typer.Argument(metavar="CONFIG", help=_CONFIG, show_default=False, autocompletion=completion.configs),
]
Out = Annotated[Path | None, typer.Option(help="Result folder (default: `results/<name>`).")]
_TRUST = "Load .zip files of Stable-Baselines3: their pickles can run any code."
TrustPickle = Annotated[bool, typer.Option("--trust-pickle", help=_TRUST)]


def _version(show: bool) -> None:
    if show:
        from importlib.metadata import version

        print(f"fieldgym {version('fieldgym')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    del version


@app.command("list")
def list_(
    name: Annotated[
        str | None,
        typer.Argument(
            help="Only the task and the machine of this name; or your own machine's file, or a `bench.yaml`.",
            show_default=False,
            autocompletion=completion.tasks_and_machines,
        ),
    ] = None,
    agents: Annotated[bool, typer.Option("--agents", help="Only the tasks' agents.")] = False,
    as_json: Json = False,
) -> None:
    """Show the tasks, their agents, the machines with their effects, and the trained policies.

    For example:

        fieldgym list

        fieldgym list rig

        fieldgym list my_machine.py

        fieldgym list --agents

        fieldgym list --json | jq '.machines[].effects[].name'
    """
    from fieldagents import catalogue

    own = catalogue.own_machine(name) if name else None
    found = own or catalogue.selected(catalogue.catalogue(), name, agents)
    as_before = {"models": found["machines"]} if "machines" in found else {}  # the key of 0.1
    print_result(as_json, found | as_before, partial(catalogue.show, found))


@app.command()
def train(
    config: ConfigPath,
    overrides: Settings = None,
    seed: Annotated[int | None, typer.Option(help="Training seed; short for `--set seed=N`.")] = None,
    until_plateau: Annotated[
        bool,
        typer.Option(
            "--until-plateau", help="End where validation gains no more; `validation.until_plateau=true`."
        ),
    ] = False,
    resume: Annotated[
        Path | None,
        typer.Option(metavar="RUN", help="Go on with an interrupted run, exactly where it stopped."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Run folder (default: `runs/<task>/<name>-<hash>`).")
    ] = None,
    dry_run: DryRun = False,
    as_json: Json = False,
) -> None:
    """Train a learned agent from a config; needs `pip install 'fieldgym[train]'`.

    The run folder holds the config, versions, TensorBoard logs, checkpoints, the learning curve and the
    policy as ONNX, which `fieldgym evaluate` takes as an agent.

    For example:

        fieldgym train configs/heel_strike/ppo.yaml

        fieldgym train heel_strike/ppo --seed 2 --set steps=2e5

        fieldgym train configs/heel_strike/ppo.yaml --resume runs/heel_strike/ppo-1a2b3c4d
    """
    from fieldagents import plan
    from fieldagents.config import load_config
    from fieldagents.learned.config import TrainConfig
    from fieldagents.learned.training import run_folder, self_contained
    from fieldagents.learned.training import train as run

    overrides = [*(overrides or []), *([] if seed is None else [f"seed={seed}"])]
    overrides += ["validation.until_plateau=true"] if until_plateau else []
    checked = self_contained(load_config(config, TrainConfig, overrides))
    announce(plan.of_training(checked, run_folder(checked, resume, out)), dry_run, as_json)
    folder = run(checked, resume=resume, progress=not as_json, out=out)
    print_files({"run": folder}, as_json)


@app.command()
def evaluate(
    config: ConfigPath,
    overrides: Settings = None,
    out: Out = None,
    engine: EngineName = "local",
    workers: Workers = 0,
    address: Address = "",
    trust_pickle: TrustPickle = False,
    dry_run: DryRun = False,
    as_json: Json = False,
) -> None:
    """Compare agents on the same published episode seeds, with intervals and verdicts.

    Writes `episodes.parquet` (one row for each agent and episode), `summary.json` and `report.html`. What was
    played before with the same config and code is not played again. A config with the key `suite` puts
    several evaluations into one table: `suite.json`, `suite.csv` and `report.html`. One with the key
    `realities` draws realities, records and diagnoses each, and tells what that wins back: `realities.json`,
    `realities.parquet` and `realities.html`.

    For example:

        fieldgym evaluate configs/heel_strike/benchmark.yaml

        fieldgym evaluate configs/heel_strike/benchmark.yaml --set episodes=20 --set 'agents=[ranger, ppo]'

        fieldgym evaluate benchmark --workers 2
    """
    from fieldagents import plan
    from fieldagents.config import has_key, load_config
    from fieldagents.evaluation.config import EvaluateConfig
    from fieldagents.evaluation.evaluate import evaluate as run
    from fieldagents.evaluation.report import show
    from fieldmodels.engine import Engine

    by = Engine(engine, workers, address)
    if has_key(config, "suite"):
        _evaluate_suite(config, overrides or [], out, by, dry_run, as_json)
        return
    if has_key(config, "realities"):
        _close_loops(config, overrides or [], out, by, dry_run, as_json)
        return
    overrides = [*(overrides or []), *(["trust_pickle=true"] if trust_pickle else [])]
    checked = load_config(config, EvaluateConfig, overrides)
    out = out or Path("results") / checked.name
    folder = begin(plan.of_evaluation([checked], checked.name, out, by), dry_run, as_json)
    with progress() as report:
        summary = run(checked, folder, report, by)
    written = {name: folder / name for name in ("episodes.parquet", "summary.json", "report.html")}
    print_result(as_json, summary.to_json(), partial(show, summary), written)


def _evaluate_suite(
    config: Path, overrides: list[str], out: Path | None, engine: Engine, dry_run: bool, as_json: bool
) -> None:
    """Run several evaluations, and put them into one table."""
    from fieldagents import plan
    from fieldagents.config import load_config
    from fieldagents.evaluation.suite import SuiteConfig, evaluate_suite, show

    checked = load_config(config, SuiteConfig, overrides)
    out = out or Path("results") / checked.name
    planned = plan.of_evaluation(list(checked.members().values()), checked.name, out, engine)
    folder = begin(planned, dry_run, as_json)
    with progress() as report:
        lines = evaluate_suite(checked, folder, report, engine)
    written = {name: folder / name for name in ("suite.json", "suite.csv", "report.html")}
    print_result(as_json, [asdict(line) for line in lines], partial(show, lines), written)


def _close_loops(
    config: Path, overrides: list[str], out: Path | None, engine: Engine, dry_run: bool, as_json: bool
) -> None:
    """Close the loop in drawn realities."""
    from fieldagents import plan
    from fieldagents.config import load_config
    from fieldagents.retune.config import RealitiesConfig
    from fieldagents.retune.realities import FILES, close_loops, show

    checked = load_config(config, RealitiesConfig, overrides)
    out = out or Path("results") / checked.name
    folder = begin(plan.of_realities(checked, out, engine), dry_run, as_json)
    with progress() as report:
        result = close_loops(checked, folder, report, engine)
    print_result(as_json, result.to_json(), partial(show, result), {name: folder / name for name in FILES})


@app.command()
def sweep(
    config: ConfigPath,
    overrides: Settings = None,
    out: Out = None,
    engine: EngineName = "local",
    workers: Workers = 1,
    address: Address = "",
    dry_run: DryRun = False,
    as_json: Json = False,
) -> None:
    """Train a grid of runs, or search hyper-parameters; on this machine or on a Ray cluster.

    The same command goes on where it was stopped: only what is missing runs. A search needs
    `pip install 'fieldgym[tune]'`, the engine ray `pip install 'fieldgym[cluster]'`.

    For example:

        fieldgym sweep heel_strike/sweep --workers 2

        fieldgym sweep heel_strike/tune --engine ray --address auto
    """
    from fieldagents import plan
    from fieldagents.sweep.run import load, show
    from fieldagents.sweep.run import run as run_sweep
    from fieldmodels.engine import Engine

    by, checked = Engine(engine, workers, address), load(config, overrides or [])
    out = out or Path("results") / checked.name
    folder = begin(plan.of_sweep(checked, out, by), dry_run, as_json)
    with progress() as report:
        found = run_sweep(checked, folder, by, report)
    print_result(as_json, found.data, partial(show, found), found.files)


@app.command()
def record(
    config: ConfigPath,
    overrides: Settings = None,
    out: Out = None,
    dry_run: DryRun = False,
    as_json: Json = False,
) -> None:
    """Run a machine in a (hidden) reality and save what its sensors measure, as CSV or Parquet.

    The recording is what `fieldgym diagnose` reads; the reality is written beside it, as
    `<name>.reality.yaml`.

    For example:

        fieldgym record configs/heel_strike/record.yaml

        fieldgym record configs/heel_strike/record.yaml --set reality.gyro_bias.rate=0.004 --set seed=3
    """
    from fieldagents import plan
    from fieldagents.config import load_config
    from fieldagents.record import record as run
    from fieldagents.record.config import RecordConfig

    checked = load_config(config, RecordConfig, overrides or [])
    out = out or Path("results") / checked.name
    folder = begin(plan.of_recording(checked, out), dry_run, as_json)
    print_files(run(checked, folder), as_json)


_DATA = "Logs of any format, or names of public recordings; files of one run as `a.csv+b.csv`."
_MACHINE = "Machine that the log is of: a name of `fieldgym list`, or a Python file of yours, which is run."
_TEST = "Separate recording on which the gain is measured; repeatable."
_COLUMN = "Which column holds a signal, as in `torque=-2.5*tau:N cm`, in all files or in one; repeatable."
_ALIGN = """Move the clocks of several files of one run until their signals agree best: an assumption, under
which no delay can be told."""
_INPUT = "`none`: nothing was commanded, all inputs are zero (a ring-down, a coast-down)."
_HOLD = """What the inputs do between samples: `held`, as a controller commands them, or `interpolated`, as
sampled analogue signals (default: as the machine says, or fits better)."""
_WINDOW = """`record`: run through each episode from one start, for slow processes with hidden states
(default: as the machine says, else windows that each have their own start)."""
_BUDGET = "Give the best verdict after this time, and what was not tried (default: none)."
_CALL_LIMIT = "Stop a machine of your own if one call into it takes longer (processor time; default: none)."
_THEN = "Then tune an agent in the extended simulation, and test it beside the nominal one."


@app.command()
def diagnose(
    data: Annotated[
        list[str], typer.Argument(metavar="DATA...", help=_DATA, autocompletion=completion.recordings)
    ],
    machine: Annotated[
        str,
        typer.Option(
            "--machine", "--model", metavar="NAME", help=_MACHINE, autocompletion=completion.machines
        ),
    ],
    test: Annotated[
        list[str] | None, typer.Option(metavar="DATA", help=_TEST, autocompletion=completion.recordings)
    ] = None,
    fixed: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PARAMETER=VALUE", help="Hold a base parameter fixed; repeatable."),
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(metavar="[FILE:]SIGNAL=[GAIN*]COLUMN[+OFFSET][:UNIT]", help=_COLUMN),
    ] = None,
    bench: Annotated[
        Path | None,
        typer.Option(help="Bench file that says what the columns are (default: `bench.yaml` beside a log)."),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(metavar="HZ", help="Rows a second, for logs without a column of times.", min=1e-6),
    ] = None,
    accept: Annotated[
        bool, typer.Option("--accept", help="Take the columns as proposed, and keep them in a `bench.yaml`.")
    ] = False,
    align: Annotated[bool, typer.Option("--align", help=_ALIGN)] = False,
    input_: Annotated[Literal["none"] | None, typer.Option("--input", help=_INPUT)] = None,
    hold: Annotated[Literal["held", "interpolated"] | None, typer.Option(help=_HOLD)] = None,
    out: Annotated[
        Path | None, typer.Option(help="Result folder (default: `results/diagnosis-<machine>`).")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the resampling.", min=0, max=LARGEST_SEED)] = 0,
    window: Annotated[Literal["record"] | None, typer.Option(help=_WINDOW)] = None,
    budget: Annotated[float | None, typer.Option(metavar="SECONDS", help=_BUDGET)] = None,
    call_limit: Annotated[float | None, typer.Option(metavar="SECONDS", help=_CALL_LIMIT, min=0.01)] = None,
    then_retune: Annotated[
        Path | None, typer.Option(metavar="CONFIG", help=_THEN, autocompletion=completion.configs)
    ] = None,
    dry_run: DryRun = False,
    as_json: Json = False,
) -> None:
    """Find from measured data what the simulation gets wrong, and by how much naming it helps.

    DATA: any log. What its columns are is read from their names and units; what these leave open is proposed
    from the data, to be confirmed or corrected once.
    Writes `diagnosis.json`, `report.html` and `extended.yaml`, which `gym.make(..., reality=...)`,
    `fieldgym train` and `fieldgym evaluate` accept. With `--then-retune` also `retune.json`, `retune.html`
    and `retune.parquet`.

    For example:

        fieldgym diagnose bench.csv --machine rig --test bench2.csv

        fieldgym diagnose log.csv --machine pendulum --column t=time --column angle=position:deg

        fieldgym diagnose messung.xlsx --machine pendulum --accept

        fieldgym diagnose swings_out.csv --machine pendulum --input none

        fieldgym diagnose dfki_simple_pendulum/ddp --machine pendulum

        fieldgym diagnose walk.csv --machine heel_strike --then-retune configs/heel_strike/retune.yaml

        fieldgym diagnose log.csv --machine my_bench.py
    """
    began = perf_counter()
    from fieldagents import findings, plan
    from fieldagents.logs import Logs, asked, declared
    from fieldmodels.machine import held_inputs
    from fieldmodels.model_files import is_model_file, load_model_file
    from fieldmodels.registry import get_model

    chosen = get_model(machine) if call_limit is None else load_model_file(machine, call_limit)
    if hold is not None:
        chosen = held_inputs(chosen, hold)
    held = findings.fixed_parameters(chosen, fixed or [])
    loop = None
    if then_retune is not None:
        from fieldagents.retune import load_loop

        loop = load_loop(then_retune, chosen)
    ask = asked if sys.stdin.isatty() and not as_json else None
    silent = input_ == "none"
    logs = Logs(chosen, declared(chosen, column or []), bench, rate, accept, align, ask, commanded=not silent)
    read = logs.read_all([*data, *(test or [])])
    recordings, tests = read[: len(data)], read[len(data) :]

    from fieldmodels.diagnosis import diagnose as run
    from fieldmodels.diagnosis.answer import in_words
    from fieldmodels.diagnosis.report import write_results

    out = out or Path("results") / f"diagnosis-{chosen.name}"
    folder = begin(plan.of_diagnosis(chosen, recordings, tests, held, out, loop), dry_run, as_json)
    checked: AbstractContextManager[None] = nullcontext()
    if is_model_file(machine):
        from fieldmodels.contract import kept

        checked = kept(chosen.scaled_to(recordings), recordings[0], machine)
    with checked, progress() as report:
        diagnosis = run(
            chosen, recordings, tests, fixed=held, progress=report, seed=seed, budget=budget, window=window
        )
    diagnosis = replace(diagnosis, seconds=perf_counter() - began)
    written = write_results(diagnosis, folder)
    result = diagnosis.to_json()
    shows: list[Callable[[Console], None]] = [partial(findings.show, result, said=in_words(diagnosis))]
    if loop is not None:
        from fieldagents.retune import finish

        with progress() as report:
            retuned = finish(diagnosis, loop, written["extended.yaml"], folder, report)
        result["retune"] = retuned.to_json()
        shows.append(retuned.show)
        written |= retuned.files
    print_result(as_json, result, lambda console: [show(console) for show in shows], written)


@app.command("open")
def open_(
    logs: Annotated[list[Path] | None, typer.Argument(metavar="[LOG]...", help="Logs to begin with.")] = None,
    out: Annotated[Path, typer.Option(help="Result folder.")] = Path("results/open"),
    port: Annotated[int, typer.Option(help="Port of the page; 0 for a free one.", min=0, max=65535)] = 0,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Only print its address.")] = False,
    as_json: Json = False,
) -> None:
    """Open a page in the browser: see logs, diagnose them, try values; needs `pip install 'fieldgym[app]'`.

    The page is served to this machine alone, and only to who has the address with its token.

    For example:

        fieldgym open bench.csv
    """
    from fieldagents.app.server import serve

    say = (lambda address: print_json({"address": address})) if as_json else print
    serve(logs or [], claim_folder(out), port, browser=not no_browser, say=say)


@app.command()
def export(
    extended: Annotated[Path, typer.Argument(metavar="EXTENDED", help="`extended.yaml` of a diagnosis.")],
    out: Annotated[Path, typer.Argument(metavar="FILE", help="Python file to write.")],
    machine: Annotated[
        str,
        typer.Option(
            "--machine",
            "--model",
            metavar="NAME",
            help="Your own machine's file (default: the machine that was diagnosed).",
            autocompletion=completion.machines,
        ),
    ] = "",
    as_json: Json = False,
) -> None:
    """Write the extended simulation of a machine as one Python file that needs NumPy alone.

    The file's `simulate` gives what the simulation gives here, and it can be run on a table of commands.

    For example:

        fieldgym export results/diagnosis-rig/extended.yaml rig.py

        python rig.py log.csv simulated.csv
    """
    from fieldmodels.drivers.named import extended_model
    from fieldmodels.export import write_model

    write_model(*extended_model(extended, machine), out)
    print_files({"model": str(out)}, as_json)


@app.command()
def schema(
    kind: Annotated[
        str,
        typer.Argument(
            help="`train`, `evaluate`, `suite`, `realities`, `sweep`, `tune`, `record` or `retune`."
        ),
    ],
) -> None:
    """Print the JSON Schema of a kind of config, by which an editor checks and completes it.

    Shipped configs name theirs in a line `# yaml-language-server: $schema=...`.

    For example:

        fieldgym schema train > train.json
    """
    from fieldagents.schema import schema as schema_of

    print_json(schema_of(kind))


_AGENT = """Who acts (default: the agent that the task shows): a name, a `policy.onnx`, a run's folder,
`module:Class`, a `.zip`."""


@app.command()
def watch(
    task: Annotated[
        str,
        typer.Argument(help="Name of the task; `fieldgym list` names them.", autocompletion=completion.tasks),
    ],
    agent: Annotated[str | None, typer.Option(help=_AGENT, autocompletion=completion.agents)] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="`settings.KEY=VALUE`, `reality.EFFECT.PARAMETER=VALUE`."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the episode.", min=0, max=LARGEST_SEED)] = 0,
    out: Annotated[
        Path | None, typer.Option(help="Write a film (`.gif`, `.webp`, `.mp4`) instead of opening a window.")
    ] = None,
    seconds: Annotated[float, typer.Option(help="Longest film [s].", min=0.1, max=600)] = 20.0,
    save: Annotated[
        Path | None, typer.Option(help="Drive by hand, and add the drive to this table, which is an agent.")
    ] = None,
    trust_pickle: TrustPickle = False,
    as_json: Json = False,
) -> None:
    """Watch an agent at work, in a window or as a film.

    For example:

        fieldgym watch heel_strike --agent ppo

        fieldgym watch heel_strike --agent adaptive --set settings.collision_kind=low_pass --out walk.gif

        fieldgym watch pose_reaching --set settings.starts=T1 --seed 3 --save drives.csv

        fieldgym watch pose_reaching --agent drives.csv
    """
    from fieldagents.config import environment_of
    from fieldagents.watch import watch as run

    environment = environment_of(task, overrides or [])
    with progress() as report:
        seen = run(
            task, agent, environment, seed=seed, film=out, seconds=seconds, save=save,
            trust_pickle=trust_pickle, progress=report,
        )  # fmt: skip
    result = {
        "agent": seen.agent, "seed": seed, "steps": seen.steps, "return": seen.episode_return,
        "finished": seen.finished, "film": None if out is None else str(out), "drives": seen.kept or None,
    }  # fmt: skip
    print_result(as_json, result, lambda _: print_files({k: v for k, v in result.items() if v is not None}))


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Result folder.")] = Path("results/demo"), as_json: Json = False
) -> None:
    """Evaluate the agents and diagnose a recording, ending in one self-contained report.html.

    Takes a minute and prints what came out. A real recording is taken when `FIELDGYM_DATA` or the network has
    it; else one of a simulated pendulum that is shipped, and the report says which.

    For example:

        fieldgym demo

        fieldgym demo --out /tmp/demo
    """
    from fieldagents.demo import NEXT, run_demo

    with progress() as report:
        done = run_demo(claim_folder(out), report)
    files = {"report": str(done.page)}
    print_result(as_json, files, lambda console: console.print("\n".join(done.findings), markup=False), files)
    if not as_json:
        print(*NEXT, sep="\n")


checkout.add_command(app, "exam", "tests/exam")
checkout.add_command(app, "reproduce", "papers")


def main() -> None:
    """Run the command line; a terminal that lacks a character shows another."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    app()
