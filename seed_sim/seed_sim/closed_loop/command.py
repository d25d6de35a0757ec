# SPDX-License-Identifier: Apache-2.0
"""`./seed evaluate`: the closed loop without ROS, for one seed or swept over scenarios."""

import argparse
import sys
from pathlib import Path
from typing import Any

from seed_control.parameters import LAW_HELP
from seed_control.parameters import LAWS as CONTROL_LAWS
from seed_control.tasks import LEAST_FORCE, MOST_FORCE, load_task, shipped_tasks
from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command, number, results_folder, seed_number, to_json, whole
from seed_core.wrench_settings import WRENCH_MODELS
from seed_estimation.parameters import METHOD_HELP
from seed_sim.closed_loop.evaluate import LAWS, SEED, check_task, evaluate, scenario_of
from seed_sim.closed_loop.progress import progress_bar
from seed_sim.closed_loop.recording import SETTLING, scored_phase
from seed_sim.closed_loop.relative_poses import ESTIMATORS, FROM_IMAGES
from seed_sim.closed_loop.sweep import plot, sweep
from seed_sim.scenario import COLUMNS, load_scenario, shipped_scenarios
from seed_sim.world import perturb
from seed_sim.world.parameters import Kind
from seed_sim.world.perturb import PERTURBATIONS
from seed_sim.world.score import DRAWS, score_draws, table
from seed_sim.world.trial import check_kind

_PICTURES = (".png", ".jpg", ".svg", ".pdf")  # endings
_OF_HIDDEN = ("draws", "membranes", "late_stamps", "model", "out")  # options


@command("seed evaluate")
def main(argv: list[str]) -> int:
    """Command line: 1 when the task did not come to its end, in a sweep or in draws that of any run."""
    parser = _parser()
    args = parser.parse_args(argv)
    hidden = args.world == "hidden" or (args.world is None and bool(args.draws or args.late_stamps or args.membranes))
    if args.estimator is None:
        args.estimator = "rigid_fit" if hidden or args.perturb else "truth"
    if args.plot is not None and (hidden or args.perturb):
        parser.error("--plot is of one run or of a sweep in known worlds: use it without --world hidden and --perturb")
    if why := _left_out(args, hidden):
        parser.error(why)
    if args.perturb:
        return _perturb(args)
    if hidden:
        return _draws(args)
    return _sweep(args) if args.scenarios else _one(args)


def _left_out(args: argparse.Namespace, hidden: bool) -> str:
    """Why an option would have no effect, and what to give instead; '' if all have one."""
    given = {name for name, value in vars(args).items() if value is not None and value is not False}
    if args.perturb:
        other = sorted(given & {*_OF_HIDDEN, "scenarios", "column", "membrane"} - {"draws"})
        return f"{_option(other[0])} has no part in --perturb: leave out either" if other else ""
    if hidden:
        for name, instead in (("scenarios", "--draws N"), ("column", "--scenario NAME"), ("membrane", "--membranes")):
            if name in given:
                return f"{_option(name)} belongs to known worlds: give {instead}"
        if args.late_stamps and args.estimator not in FROM_IMAGES:
            return f"--late-stamps is of images, which --estimator {args.estimator} does not look at: give another"
        return ""
    if other := [name for name in (*_OF_HIDDEN, "arm_sensor") if name in given]:
        return f"{_option(other[0])} belongs to hidden worlds: give --world hidden"
    if not args.scenarios:
        return "--column belongs to a sweep: give --scenarios N as well" if args.column else ""
    if args.membrane is not None:
        return "--membrane is of one run: leave out --scenarios, or give --draws N --membranes"
    both = args.column and args.scenario is not None
    return "--column and --scenario both name what a sweep goes over: give one of them" if both else ""


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _parser() -> argparse.ArgumentParser:
    p = Parser(
        prog="seed evaluate",
        description="Play a task in closed loop without ROS, faster than real time, and score the plant's own forces.\n"
        "With --world hidden, the default score: --draws of cells, drawn as docs/worlds.md says, of which estimator\n"
        "and controller know only what calibration, identification, clock comparison and weighing find in each.\n"
        "With --scenarios N, sweep over seeds and columns of cells that are as believed.",
    )
    p.add_argument("task", help=f"a task file, or a shipped task: {', '.join(shipped_tasks())}")
    p.add_argument(
        "--law",
        choices=LAWS,
        default="seed",
        help=f"{LAW_HELP}. Baselines: open_loop goes where the table should be and measures nothing; welded has its "
        "tool bolted on, with an ideal sensor of the force along z; welded_roll of the torque about x as well",
    )
    p.add_argument(
        "--estimator",
        choices=ESTIMATORS,
        help="where relative poses come from: truth is exact, noisy is that with noise and delay, the others work on "
        f"rendered images: {METHOD_HELP}; default: truth, and rigid_fit in hidden worlds",
    )
    p.add_argument(
        "--force",
        type=number(LEAST_FORCE, "N", MOST_FORCE),
        help="[N] size of every force in the task; its own if left out",
    )
    p.add_argument(
        "--seed", type=seed_number, default=SEED, help="draws table and errors; first seed of a sweep, first draw"
    )
    p.add_argument("--scenario", help=f"one of {', '.join(shipped_scenarios())}, or a file; the task's own if left out")
    p.add_argument(
        "--membrane",
        type=seed_number,
        metavar="SEED",
        help="hold the tool between two membranes with mechanics, drawn from this seed (docs/membrane.md)",
    )
    p.add_argument("--scenarios", type=whole(1), metavar="N", help="sweep: seeds per column")
    p.add_argument(
        "--column",
        action="append",
        choices=shipped_scenarios(),
        metavar="NAME",
        help="sweep: only this column, any shipped scenario (may be repeated)",
    )
    p.add_argument("--jobs", type=whole(1), default=1, metavar="J", help="sweep and draws: processes")
    p.add_argument(
        "--plot",
        type=Path,
        help=f"where to write a picture ({', '.join(_PICTURES)}): of one run its path and force, of a sweep every "
        "run's error",
    )
    p.add_argument(
        "--world",
        choices=("known", "hidden"),
        help="known: the cell is what the controller believes, one quick run; hidden: --draws of cells that it does "
        "not know, the score that docs and README state; default: known, and hidden with --draws or --membranes",
    )
    p.add_argument(
        "--draws",
        type=whole(1),
        metavar="N",
        help=f"hidden worlds; default: {DRAWS}. With --perturb: seeds; default: 1",
    )
    p.add_argument(
        "--membranes", action="store_true", help="hidden worlds whose grasp is two membranes, drawn with the world"
    )
    p.add_argument("--late-stamps", action="store_true", help="hidden worlds with stamps 0 to 100 ms late")
    p.add_argument(
        "--arm-sensor", action="store_true", help="hidden worlds and --perturb: the arm has a force/torque reading"
    )
    p.add_argument(
        "--model",
        choices=WRENCH_MODELS,
        help="hidden worlds: what the wrench is computed from: the paper's stiffness map, a spring that stiffens and "
        "has hysteresis, or what the membranes do, as identified in each world; default: membrane with --membranes, "
        "else hysteretic",
    )
    p.add_argument(
        "--out", type=Path, metavar="FILE", help="hidden worlds: a JSON line per draw; draws in it are not repeated"
    )
    p.add_argument(
        "--perturb",
        action="append",
        metavar="NAME",
        help=f"a cell that differs in this one thing (may be repeated; all: every one): {', '.join(PERTURBATIONS)}",
    )
    p.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return p


def _one(args: argparse.Namespace) -> int:
    how = {name: getattr(args, name) for name in ("law", "estimator", "force", "seed", "scenario", "membrane")}
    path = None if args.plot is None else _plot_file(args.plot, f"{Path(args.task).stem}-{args.law}-{args.seed}.png")
    with progress_bar(shown=not args.json) as progress:
        run = evaluate(args.task, progress=progress, **how)
    result = run.result
    print(to_json(result) if args.json else _text(result))
    if path is not None:
        from seed_sim.replay.plots import run_figure, save

        title = f"{result['task']}, scenario {result['scenario']}, seed {args.seed}, law {args.law}"
        save(run_figure(run.recording, scored_phase(load_task(args.task, args.force)), title), path, dpi=110)
        print(f"plot: {path}", file=sys.stderr)
    return 0 if result["finished"] else 1


def _text(r: dict[str, Any]) -> str:
    lean, made = r["lean_deg"], r["contact"]
    lines = [f"{r['task']}, scenario {r['scenario']}, seed {r['seed']}, law {r['law']}, estimator {r['estimator']}"]
    if not made["made"]:  # nothing to score
        return f"{lines[0]}\n  no contact, so nothing to score; {r['message'] or 'no end'}"
    if r["samples"]:
        for key, unit in (("force_z", "N  "), ("torque_x", "N m"), ("torque_z", "N m")):
            e = r[key]
            if key != "torque_z" or (e is not None and e["mean"]):
                name, worst = key.replace("_", " "), f"{e['max_abs_error']:8.3f} {unit}".rstrip()
                lines.append(
                    f"  {name:10s} rmse {e['rmse']:8.3f} {unit}   mean {e['mean']:8.3f} {unit}   worst {worst}"
                )
    else:
        lines.append(f"  nothing to score: the phase that counts did not last until {SETTLING:g} s after first contact")
    if s := r["surface"]:
        worst = f"mean {s['force_mean']:8.3f} N     peak {s['peak']:.2f} times the wanted one"
        lines.append(f"  normal     rms  {s['force_rms']:8.3f} N     {worst}")
        lines.append(f"  found      rms  {s['normal_rms_deg']:8.2f} deg   worst {s['normal_max_deg']:7.2f} deg")
    if r["samples"]:
        lines.append(f"  lean       rms  {lean['rms']:8.2f} deg   worst {lean['max']:7.2f} deg")
        lines.append(f"  path       rmse {r['path_rmse_mm']:8.2f} mm")
    if hole := r["insertion"]:
        end = f"{hole['inserted']:.1f} s after contact" if hole["success"] else "not inserted"
        lines.append(
            f"  hole       {hole['depth_mm']:.1f} mm deep, {end}; largest force {hole['largest_force']:.1f} N; it was "
            f"{hole['away_mm']:.1f} mm and {hole['tilt_deg']:.1f} degrees off"
        )
    lines.append(f"  contact    at {made['time']:.2f} s; {r['message'] or 'no end'}")
    lines.append(f"  simulated {r['real_time_factor']:.1f} times as fast as real time")
    return "\n".join(lines)


def _draws(args: argparse.Namespace) -> int:
    """The score over hidden worlds: 1 when a draw was not finished."""
    names = ("task", "law", "model", "estimator", "force", "scenario", "late_stamps", "arm_sensor")
    kind: Kind = "membrane" if args.membranes else "spring"
    settings = {name: getattr(args, name) for name in names} | {"world": kind}
    if args.law not in CONTROL_LAWS:
        raise SeedError(f"--law {args.law} is a baseline, which knows nothing to be wrong of: use --world known")
    task = load_task(args.task, args.force)  # a mistake here would break every run
    scenario = load_scenario(args.scenario or scenario_of(task))
    check_task(task, scenario, args.law)
    check_kind(kind, scenario, args.model, args.estimator)
    draws = range(args.seed, args.seed + (args.draws or DRAWS))
    result = score_draws(settings, draws, args.jobs, args.out, shown=not args.json)
    print(to_json(result) if args.json else table(result))
    return 1 if result["summary"]["not_finished"] else 0


def _perturb(args: argparse.Namespace) -> int:
    given = {name: getattr(args, name) for name in ("law", "estimator", "force", "scenario", "arm_sensor")}
    seeds = range(args.seed, args.seed + (args.draws or 1))
    rows = perturb.perturbed(args.perturb, args.task, seeds, **given, jobs=args.jobs, shown=not args.json)
    print(to_json(rows) if args.json else perturb.table(rows))
    return 0


def _sweep(args: argparse.Namespace) -> int:
    images = args.estimator in FROM_IMAGES  # micro-slip of the membrane exists in images only
    columns = args.column or ([args.scenario] if args.scenario else [*COLUMNS, *(("slip20",) if images else ())])
    task = load_task(args.task, args.force)  # a mistake here would break every run
    for column in columns:
        check_task(task, load_scenario(column), args.law)
    seeds = list(range(args.seed, args.seed + args.scenarios))
    path = _plot_file(args.plot, f"sweep-{Path(args.task).stem}-{args.law}-{args.seed}.png", json=args.json)
    how = {"law": args.law, "estimator": args.estimator, "force": args.force, "jobs": args.jobs}
    result = sweep(args.task, columns, seeds, **how)
    print(to_json(result) if args.json else _table(result))
    if path is not None:
        plot(result, path)
        print(f"plot: {path}", file=sys.stderr)
    return 1 if any(c["failed"] for c in result["columns"].values()) else 0


def _plot_file(asked: Path | None, name: str, *, json: bool = False) -> Path | None:
    """Where a plot goes, its folder made before the minutes that a sweep takes: a folder takes it under its usual name.

    Without --plot a sweep's goes to the results, and with --json alone nowhere. Raises SeedError: it is no picture.
    """
    if asked is None and json:
        return None
    path = results_folder() / name if asked is None else asked / name if asked.is_dir() else asked
    if path.suffix.lower() not in _PICTURES:
        raise SeedError(f"--plot {path}: name a folder, or a file that ends in one of: {', '.join(_PICTURES)}")
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _table(result: dict[str, Any]) -> str:
    figures = f"{'force rmse mean':>15s} {'p95':>7s} {'max':>7s} {'lean rms':>9s} {'lean max':>9s}"
    lines = [f"{'column':18s} {figures} {'scored':>9s}  failed"]
    for name, c in result["columns"].items():
        if not c["scored"]:
            first = c["runs"][0]
            lines.append(f"{name:18s} no run was scored: {first.get('error') or first['message'] or 'no end'}")
            continue
        f, rms, most = c["force_z_rmse"], c["lean_deg_rms"]["mean"], c["lean_deg_max"]["max"]
        numbers = f"{f['mean']:13.3f} N {f['p95']:7.3f} {f['max']:7.3f} {rms:9.2f} {most:9.2f}"
        scored = f"{c['scored']} of {len(c['runs'])}"
        lines.append(f"{name:18s} {numbers} {scored:>9s}  {c['failed'] or '-'}")
    return "\n".join(lines)
