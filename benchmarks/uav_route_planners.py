"""The source's program and its alternatives on the source's example, side by side in one run.

    python benchmarks/uav_route_planners.py --sides 24
    python benchmarks/uav_route_planners.py --readings
    python benchmarks/uav_route_planners.py --layouts --work 40000
    python benchmarks/uav_route_planners.py --two
    python benchmarks/uav_route_planners.py --agents 20
    python benchmarks/uav_route_planners.py --proofs 12 --work 150000
    python benchmarks/uav_route_planners.py --gaps 100

For detection thresholds 0.5, 0.6, 0.7, and for 0.5 with a lock lost in four steps: the program as printed,
the same with its table's headings added up, whole legs, and the lattice. One line a plan, as it comes: how
the search ended, its size, its time, the ratio of the printed program's time to it, and what the continuous
model says of the plan. The source's program has 15,363 binaries, 72 linear variables and 10,359 constraints.
``--readings`` prints what the slack and the form of (4.33) change, flown with the bank and without;
``--layouts`` a detour around one radar and a way between three, with the ratio to the lattice's time;
``--two`` the source's two aircraft; ``--agents`` what the planning agents need on random layouts;
``--proofs`` how the source's program ends on test layouts, and which of its plans survive; ``--gaps`` how far
the certified planner may be from the best over random layouts of one to three radars.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from functools import partial
from typing import Any

import gymnasium
import numpy as np

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.seeds import TEST_SEEDS, TUNING_SEEDS
from fieldagents.task import get_task
from fieldagents.tasks.uav_route import agents
from fieldagents.tasks.uav_route.agents import legs, legs_lock_loss, legs_low, over_lattice, printed
from fieldagents.tasks.uav_route.certified import certified_plan
from fieldagents.tasks.uav_route.lattice import lattice_plan
from fieldagents.tasks.uav_route.legs import leg_plan
from fieldagents.tasks.uav_route.lower_bound import layouts_of
from fieldagents.tasks.uav_route.plan import Plan
from fieldagents.tasks.uav_route.printed import Form, joint_printed_plans, printed_plan
from fieldgym.uav_route import UavRouteSettings
from fieldmodels.machines.uav_route.layouts import random_layout
from fieldmodels.machines.uav_route.parameters import EXAMPLE, SECOND_UAV, Aircraft, Detection, Layout, World
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan

HEAD = (
    f"{'Pd':>3} {'planner':26} {'solver':8} {'ended':9} {'gap':>5} {'steps':>5} "
    f"{'binaries':>8} {'linear':>6} {'constr.':>7} {'time/s':>7} {'ratio':>7} "
    f"{'length':>7} {'excess':>7} {'over/s':>6} {'longest':>7} {'max Pd':>6} hit"
)


def line(plan: Plan, threshold: float, printed: Plan) -> str:
    """One plan as a line of the table."""
    s, c = plan.search, plan.verification
    steps = 0 if plan.durations is None else len(plan.durations)
    text = (
        f"{threshold:3.1f} {plan.planner:26} {s.solver:8} {s.status:9} {s.gap:5.1%} {steps or '':5} "
        f"{s.counts.integers:8} {s.counts.continuous:6} {s.counts.constraints:7} {s.seconds:7.2f} "
        f"{printed.search.seconds / s.seconds:7.1f}"
    )
    if c is None:
        return f"{text}  {s.reason}"
    return (
        f"{text} {plan.length:7.2f} {plan.excess:7.2%} {c.time_over:6.1f} {c.longest_detection:7.1f} "
        f"{c.largest_probability:6.3f} {'no' if c.survived else 'yes'}"
    )


def readings(more: dict[str, Any]) -> None:
    """What the printed slack and the printed form of (4.33) do."""
    level = World(aircraft=Aircraft(bank=0.0))
    forms = [Form(sides=m, lookup="sets", slack=s) for m in (24, 36, 48) for s in (1.01, None)]
    forms += [Form(lookup="sets", lock_loss=4, detections=d) for d in ("at_most", "exactly")]
    for form in forms:
        plan = printed_plan(EXAMPLE, form=form, **more)
        print(f"M {form.sides}, slack {form.slack}, lock loss {form.lock_loss}, {form.detections}")
        print(line(plan, 0.5, plan), flush=True)
        if plan.found:
            flown = simulate_plan(
                plan.waypoints, EXAMPLE.radars, level, durations=plan.durations
            ).verification
            print(f"    level: over {flown.time_over:.1f} s, largest Pd {flown.largest_probability:.3f}")


def layouts(more: dict[str, Any]) -> None:
    """Layouts that are harder than the source's example."""
    around = Layout((0.0, 600.0), (340.0, 0.0), EXAMPLE.radars)
    three = Layout((-100.0, -600.0), (0.0, 600.0), ((0.0, 0.0), (700.0, 250.0), (-700.0, 250.0)))
    for name, layout, spacing, detour in (("around", around, 20.0, 1.5), ("three radars", three, 40.0, 2.0)):
        lattice = lattice_plan(layout, spacing=spacing, detour=detour)
        print(f"{name}: lower bound {lattice.lower_bound:.1f} km")
        step = 1.2 * lattice.length / (12 * World().aircraft.speed)
        form = Form(lookup="sets", step_time=step)
        planned = (
            ("two legs", partial(leg_plan, layout, legs=2, **more)),
            ("three legs", partial(leg_plan, layout, legs=3, **more)),
            ("guided by the lattice", partial(leg_plan, layout, guide=lattice.waypoints, **more)),
            ("lattice", lambda plan=lattice: plan),
            ("lock loss", partial(lattice_plan, layout, spacing=spacing, detour=detour, lock_loss=True)),
            (f"12 steps of {step:.0f} s", partial(printed_plan, layout, form=form, **more)),
        )
        for title, function in planned:
            print(f"{title}:\n{line(function(), 0.5, lattice)}", flush=True)


def two(more: dict[str, Any]) -> None:
    """The source's two aircraft: each alone, and both in one program."""
    for form in (Form(lookup="sets"), Form(lookup="sets", lock_loss=4)):
        print(f"two aircraft, lock loss {form.lock_loss}")
        for group in ((EXAMPLE,), (SECOND_UAV,), (EXAMPLE, SECOND_UAV)):
            for plan in joint_printed_plans(group, form=form, **more):
                print(line(plan, 0.5, plan), f" cost {plan.search.objective:g} s", flush=True)


def proofs(count: int, work: int | None) -> None:
    """How the source's program ends on test layouts, and what its plans are worth."""
    seeds = TEST_SEEDS[:count]
    agents.WORK = work or 10**9
    print(
        "seed,lock_loss,status,work,processor_s,steps_bound_s,steps_s,gap,outcome,length_km,over_s,longest_s"
    )
    for seed in seeds:
        for name in ("printed", "printed_lock_loss"):
            agent = get_task("uav_route").agents[name].make({})
            begun = time.process_time()
            table = run_episodes(agent, "uav_route", EnvironmentConfig(), range(seed, seed + 1))
            took = time.process_time() - begun
            (plan,), one = agent._plans.values(), table.iloc[0]
            search = plan.search
            outcome = "no plan" if one["no_plan"] else "arrived" if one["success"] else "hit"
            print(
                f"{seed},{name.removeprefix('printed').strip('_') or 'none'},{search.status},{search.work},"
                f"{took:.1f},{search.bound:.1f},{search.objective:.1f},{search.gap:.3f},{outcome},"
                f"{one['path_length']:.1f},{one['time_over']:.0f},{one['longest_detection']:.0f}",
                flush=True,
            )


def gaps(count: int) -> None:
    """Gap of the certified planner to its bound, and processor time, over layouts of one to three radars."""
    found = []
    for seed in range(count):
        layout = random_layout(np.random.default_rng(seed), 1 + seed % 3)
        begun = time.process_time()
        plan = certified_plan(layout)
        found.append((plan.search.gap, plan.excess, time.process_time() - begun))
        print(
            f"{seed:3d} {len(layout.radars)} {plan.search.status} {found[-1][0]:6.2%} {found[-1][2]:5.1f} s",
            flush=True,
        )
    for part in (0.5, 0.9, 1.0):
        gap, excess, took = np.quantile(np.array(found), part, axis=0)
        print(f"{part:4.0%}: gap {gap:.2%}, over tangent, arc and spiral {excess:.2%}, {took:.1f} s")


def planning_agents(count: int) -> None:
    """What the planning agents need for one of the environment's random layouts."""
    envs = gymnasium.make_vec("fieldgym/UavRoute-v1", num_envs=count, vectorization_mode="vector_entry_point")
    _, info = envs.reset(seed=TUNING_SEEDS[0])
    drawn = layouts_of(info)
    envs.close()
    settings = UavRouteSettings()
    planners = {
        "legs": legs,
        "legs-low": legs_low,
        "legs-lock-loss": legs_lock_loss,
        "lattice": over_lattice(settings, lock_loss=False),
        "lattice-lock-loss": over_lattice(settings, lock_loss=True),
        "printed": printed(lock_loss=False),
    }
    print(f"{'planner':20}{'median s':>10}{'largest s':>10}{'found':>7}")
    for name, planner in planners.items():
        planner(drawn[0], settings.world, None)  # compiled before any clock runs
        took, found = [], 0
        for layout in drawn:
            begun = time.perf_counter()
            found += planner(layout, settings.world, None).found
            took.append(time.perf_counter() - begun)
        print(f"{name:20}{np.median(took):10.3f}{max(took):10.2f}{found:4d}/{count}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sides", type=int, default=24, help="M of the printed program")
    parser.add_argument("--work", type=int, help="limit of each program, in the solver's steps")
    parser.add_argument("--solver", default="auto", choices=["auto", "highs", "cbc"])
    parser.add_argument("--readings", action="store_true")
    parser.add_argument("--layouts", action="store_true")
    parser.add_argument("--two", action="store_true")
    parser.add_argument("--gaps", type=int, default=0, metavar="LAYOUTS")
    parser.add_argument("--proofs", type=int, default=0, metavar="LAYOUTS")
    parser.add_argument("--agents", type=int, default=0, metavar="LAYOUTS")
    given = parser.parse_args()
    more: dict[str, Any] = {"solver": given.solver, "work": given.work}
    lattice_plan(EXAMPLE, spacing=25.0)  # compiled before any clock runs
    for threshold in (0.5, 0.6, 0.7):  # nor is it timed what each world's distances are, for anyone
        leg_plan(EXAMPLE, World(detection=Detection(threshold=threshold)), **more)
    if given.agents:
        planning_agents(given.agents)
        return
    if given.gaps:
        gaps(given.gaps)
        return
    if given.proofs:
        proofs(given.proofs, given.work)
        return
    print(HEAD, flush=True)
    if given.readings or given.layouts or given.two:
        for wanted, function in ((given.readings, readings), (given.layouts, layouts), (given.two, two)):
            if wanted:
                function(more)
        return
    form = Form(sides=given.sides)
    cases = [(0.5, form), (0.6, form), (0.7, form), (0.5, replace(form, lock_loss=4))]
    for threshold, one in cases:
        world = World(detection=Detection(threshold=threshold))
        printed = printed_plan(EXAMPLE, world, one, **more)
        print(line(printed, threshold, printed), flush=True)
        others = [lambda w=world, f=one: printed_plan(EXAMPLE, w, replace(f, lookup="sets"), **more)]
        if one.lock_loss is None:
            others += [
                lambda w=world: leg_plan(EXAMPLE, w, legs=2, **more),
                lambda w=world: leg_plan(EXAMPLE, w, legs=3, **more),
                lambda w=world: leg_plan(EXAMPLE, w, legs=4, **more),
                lambda w=world: lattice_plan(EXAMPLE, w),
            ]
        else:
            others += [
                lambda w=world, n=n: leg_plan(EXAMPLE, w, legs=n, lock_loss=True, **more) for n in (2, 3, 4)
            ]
            others.append(lambda w=world: lattice_plan(EXAMPLE, w, lock_loss=True))
        for planned in others:
            print(line(planned(), threshold, printed), flush=True)


if __name__ == "__main__":
    main()
