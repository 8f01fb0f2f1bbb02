"""Solving mixed-integer programs with PuLP: HiGHS first, CBC as fallback."""

from __future__ import annotations

import importlib
import math
import re
import tempfile
import time
from pathlib import Path
from typing import Any, Literal, get_args

from fieldagents.tasks.uav_route.plan import Counts, Search, Status
from fieldmodels.model import ModelError

Solver = Literal["auto", "highs", "cbc"]


class MissingSolverError(ImportError):
    """PuLP or its solver is not installed."""


def modelling() -> Any:
    """Return the module PuLP.

    Raises:
        MissingSolverError: If it is not installed.
    """
    try:
        return importlib.import_module("pulp")
    except ImportError:
        raise MissingSolverError(
            "planning by mixed-integer programs needs PuLP, which is not installed: "
            "pip install 'fieldgym[planning]'"
        ) from None


def pulp_highs() -> Any:
    """Return HiGHS's own module, which PuLP's interface to it needs, too."""
    return importlib.import_module("highspy")


def choose_solver(name: Solver, work: int | None = None, gap: float = 1e-6) -> Any:
    """Return a PuLP solver on one thread; ``auto`` is HiGHS, or CBC if HiGHS is not installed.

    Args:
        name: Which solver.
        work: Largest number of its steps, None for as many as it takes. HiGHS's are cut rounds, heuristics
            and nodes, counted where it asks whether to go on; CBC's are nodes. The same program with the same
            limit ends in the same way on any machine under any load, which a limit in seconds would not.
        gap: Relative gap at which a plan counts as optimal.

    Raises:
        MissingSolverError: If the solver is not installed.
        ModelError: If there is no such solver, or the work limit or the gap is not possible.
    """
    if name not in get_args(Solver):
        raise ModelError(f"solver is one of {', '.join(get_args(Solver))}, not {name!r}")
    if work is not None and work < 1:
        raise ModelError(f"the work limit is a number of the solver's steps, at least 1, not {work}")
    if not gap >= 0:
        raise ModelError(f"the gap must not be negative, not {gap}")
    pulp = modelling()
    options = {"msg": False, "gapRel": gap, "threads": 1}
    if name in ("auto", "highs"):
        highs = pulp.HiGHS(**options)
        if highs.available():
            _limit_steps(highs, work)
            return highs
    if name in ("auto", "cbc"):
        cbc = pulp.PULP_CBC_CMD(maxNodes=work, **options)
        if cbc.available():
            return cbc
    missing = "neither HiGHS nor CBC" if name == "auto" else f"no {name}"
    raise MissingSolverError(f"there is {missing} to solve programs with: pip install 'fieldgym[planning]'")


def _limit_steps(highs: Any, work: int | None) -> None:
    """Count the steps of each of the solver's runs, and interrupt a run that has taken as many as it may."""
    steps = highs.steps = [0]

    def step(_kind: Any, _message: Any, _output: Any, answer: Any, _data: Any) -> None:
        steps[0] += 1
        if work is not None and steps[0] >= work:
            answer.user_interrupt = True

    highs.callbackTuple = (step, None)
    highs.callbacksToActivate = [pulp_highs().cb.HighsCallbackType.kCallbackMipInterrupt]


def counts_of(program: Any) -> Counts:
    """Size of a PuLP program."""
    integers = sum(v.cat == "Integer" for v in program.variables())
    return Counts(len(program.constraints), integers, len(program.variables()) - integers)


def solve(program: Any, solver: Any, begun: float) -> Search:
    """Solve a program and say how that ended.

    Args:
        program: A PuLP program; its variables hold the solution afterwards, if there is one.
        solver: From ``choose_solver``.
        begun: ``time.perf_counter()`` when its building began.
    """
    pulp = modelling()
    counts, is_highs = counts_of(program), solver.name == "HiGHS"
    if is_highs:
        solver.steps[0] = 0
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "cbc.log"
        if not is_highs:
            solver.optionsDict["logPath"] = str(log)
        try:
            program.solve(solver)
        except pulp.PulpSolverError as error:
            raise MissingSolverError(f"{solver.name} did not run: {error}") from None
        told = log.read_text() if log.exists() else ""
    found = program.sol_status in (pulp.LpSolutionOptimal, pulp.LpSolutionIntegerFeasible)
    objective = float(pulp.value(program.objective)) if found else math.nan
    if is_highs:
        info = program.solverModel.getInfo()
        found = found and info.primal_solution_status == 2  # a feasible point
        work, bound = solver.steps[0], float(info.mip_dual_bound)
        bound = bound if counts.integers else math.nan  # HiGHS has none for a program without integers
    else:
        work, bound = int(_number("Enumerated nodes", told, 0.0)), _number("Lower bound", told, math.nan)
    optimal = found and program.sol_status == pulp.LpSolutionOptimal
    # CBC's "Integer infeasible" reaches only the program's status; stopped early it may say so, too
    stopped = "Stopped on" in told
    proven = not stopped and pulp.LpSolutionInfeasible in (program.sol_status, program.status)
    status: Status = "feasible" if found else "infeasible" if proven else "no plan"
    if optimal:
        status, bound = "optimal", objective if math.isnan(bound) else bound
    return Search(
        status=status,
        reason={
            "optimal": "proven optimal within this formulation",
            "feasible": "stopped at the work limit: the best plan so far, without a proof",
            "infeasible": "proven that this formulation has no plan",
            "no plan": "stopped at the work limit before any plan was found: allow more work",
        }[status],
        solver="HiGHS" if is_highs else "CBC",
        objective=objective if found else math.nan,
        bound=bound if math.isfinite(bound) else math.nan,
        work=work,
        seconds=time.perf_counter() - begun,
        counts=counts,
    )


def _number(what: str, log: str, otherwise: float) -> float:
    """A number of CBC's last words."""
    found = re.search(rf"^{what}:\s+([-+.\deE]+)", log, re.MULTILINE)
    return float(found[1]) if found else otherwise
