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


def choose_solver(name: Solver, time_limit: float | None = None, gap: float = 1e-6) -> Any:
    """Return a PuLP solver on one thread; ``auto`` is HiGHS, or CBC if HiGHS is not installed.

    Raises:
        MissingSolverError: If the solver is not installed.
        ModelError: If there is no such solver, or the time limit or the gap is not positive.
    """
    if name not in get_args(Solver):
        raise ModelError(f"solver is one of {', '.join(get_args(Solver))}, not {name!r}")
    if time_limit is not None and not time_limit > 0:
        raise ModelError(f"the time limit must be positive [s], not {time_limit}")
    if not gap >= 0:
        raise ModelError(f"the gap must not be negative, not {gap}")
    pulp = modelling()
    options = {"msg": False, "timeLimit": time_limit, "gapRel": gap, "threads": 1}
    if name in ("auto", "highs"):
        highs = pulp.HiGHS(**options)
        if highs.available():
            return highs
    if name in ("auto", "cbc"):
        cbc = pulp.PULP_CBC_CMD(**options)
        if cbc.available():
            return cbc
    missing = "neither HiGHS nor CBC" if name == "auto" else f"no {name}"
    raise MissingSolverError(f"there is {missing} to solve programs with: pip install 'fieldgym[planning]'")


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
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "cbc.log"
        if not is_highs:
            solver.optionsDict["logPath"] = str(log)
        started = time.perf_counter()
        try:
            program.solve(solver)
        except pulp.PulpSolverError as error:
            raise MissingSolverError(f"{solver.name} did not run: {error}") from None
        found = program.sol_status in (pulp.LpSolutionOptimal, pulp.LpSolutionIntegerFeasible)
        gap = _gap_of_highs(program) if is_highs else _gap_of_cbc(log)
    if is_highs:
        found = found and program.solverModel.getInfo().primal_solution_status == 2  # a feasible point
    if not found:
        gap = math.nan
    elif program.sol_status == pulp.LpSolutionOptimal and math.isnan(gap):
        gap = 0.0
    status: Status
    if found:
        # PuLP calls an incumbent at the time limit "Optimal": only the solution's own status says it
        status = "optimal" if program.sol_status == pulp.LpSolutionOptimal else "feasible"
    else:
        # CBC's "Integer infeasible" reaches only the program's status, and stopped by the time limit in its
        # first relaxation it says "Infeasible", too, of programs that are not
        in_time = is_highs or solver.timeLimit is None or time.perf_counter() - started < solver.timeLimit
        proven = in_time and pulp.LpSolutionInfeasible in (program.sol_status, program.status)
        status = "infeasible" if proven else "no answer"
    return Search(
        status=status,
        reason={
            "optimal": "proven optimal within this formulation",
            "feasible": "stopped at the time limit: the best plan so far, without a proof",
            "infeasible": "proven that this formulation has no plan",
            "no answer": "stopped at the time limit before any plan was found: allow more time",
        }[status],
        solver="HiGHS" if is_highs else "CBC",
        objective=float(pulp.value(program.objective)) if found else math.nan,
        gap=gap,
        seconds=time.perf_counter() - begun,
        counts=counts,
    )


def _gap_of_highs(program: Any) -> float:
    gap = float(program.solverModel.getInfo().mip_gap)
    return gap if math.isfinite(gap) else math.nan


def _gap_of_cbc(log: Path) -> float:
    found = re.search(r"^Gap:\s+([-+.\deE]+)", log.read_text() if log.exists() else "", re.MULTILINE)
    return float(found[1]) if found else math.nan
