# SPDX-License-Identifier: Apache-2.0
"""./seed validate: estimators of the relative pose against rendered images of known motion; the loop against faults.

seed validate estimator --method rigid_fit --scenario long_cylinder --seed 7 [--json] [--report FILE.png]
seed validate estimator --method rigid_fit --from BAG
seed validate estimator --world hidden --draws 20 [--jobs 2] [--json]
seed validate slip --seed 7 [--json]
seed validate grip --runs 20 --seed 1 [--kind pull] [--jobs 2] [--json]
seed validate gel --draws 20 --seed 100 [--jobs 2] [--json]
seed validate map --membranes 20 [--images | --noise 1] [--out FOLDER] [--json]
seed validate band --membranes 10 --seed 1 [--jobs 2] [--json]
seed validate surfaces --runs 20 --seed 1 [--kind cylinder] [--out FILE] [--jobs 2] [--json]
seed validate faults --runs 500 --seed 1 [--kind 'moving table'] [--jobs 2] [--json]
"""

import argparse
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from seed_control.parameters import LAW_HELP, LAWS
from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command, number, results_folder, seed_number, to_json, whole
from seed_estimation.parameters import METHOD_HELP, METHODS
from seed_sim.closed_loop.surfaces import SCENARIOS, surfaces
from seed_sim.closed_loop.surfaces import summary as summary_of_surfaces
from seed_sim.closed_loop.surfaces import table as table_of_surfaces
from seed_sim.faults.campaign import campaign, summary, table
from seed_sim.faults.draw import KINDS
from seed_sim.gripper import score as pulled
from seed_sim.gripper.pulls import KINDS as PULLS
from seed_sim.scenario import load_scenario, on_membrane, shipped_scenarios
from seed_testing.validation import gel, run, slip, worlds
from seed_testing.validation.figure import draw
from seed_testing.validation.maps import band, score
from seed_testing.validation.other_renderer.run import run_other
from seed_testing.validation.scores import NAMED, scores


@command("seed validate")
def main(argv: list[str]) -> int:
    """Run one of them."""
    options = _parser().parse_args(argv)
    return int(options.run(options))


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="seed validate", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="estimator|slip|grip|map|band|faults|surfaces|gel")
    for add in (_add_estimator, _add_slip, _add_map, _add_faults, _add_grip, _add_surfaces, _add_gel, _add_band):
        p = add(commands)
        p.add_argument("--jobs", type=whole(1), default=os.cpu_count() or 1, help="processes; default: one per core")
        p.add_argument("--seed", type=seed_number, default=0, help="draws motion and noise")
        p.add_argument("--json", action="store_true", help="print one JSON object")
    return parser


def _add_estimator(commands: Any) -> argparse.ArgumentParser:
    p: argparse.ArgumentParser = commands.add_parser(
        "estimator", help="accuracy, honesty and cost of an estimator over a trajectory"
    )
    p.add_argument("--method", choices=sorted(METHODS), default="rigid_fit", help=METHOD_HELP)
    p.add_argument(
        "--scenario", default="long_cylinder", help=f"{', '.join(shipped_scenarios(run.VALIDATE))}, or a .yaml file"
    )
    p.add_argument(
        "--renderer",
        choices=("own", "other"),
        default="own",
        help="other: one that shares nothing with the simulator's",
    )
    p.add_argument(
        "--astray", type=number(0.0, "1"), default=0.0, metavar="SHARE",
        help="other renderer: mounts up to 0.5 degrees and 0.5 mm off, focal length and depth 1 %%, times SHARE",
    )  # fmt: skip
    p.add_argument(
        "--membrane",
        type=seed_number,
        metavar="SEED",
        help="hold the tool between two membranes with mechanics, drawn from this seed; the motion is "
        f"{run.SCALE:g} of the scenario's, so that the tool stays in the grasp",
    )
    p.add_argument(
        "--larger", type=number(0.0, "1"), default=1.0, metavar="TIMES",
        help="with --membrane: times as large a motion; the more the tool slides on the membranes",
    )  # fmt: skip
    p.add_argument("--from", dest="bag", type=Path, help="a bag with images and ground truth instead of a scenario")
    p.add_argument(
        "--report",
        nargs="?",
        const=results_folder() / "validation.png",
        metavar="FILE.png",
        type=Path,
        help="draw truth and estimate; default: validation.png in results/",
    )
    p.add_argument("--world", choices=("known", "hidden"), default="known", help="hidden: see docs/worlds.md")
    p.add_argument("--draws", type=whole(1), default=20, help="of hidden worlds, the first being --seed")
    p.set_defaults(run=_estimator)
    return p


def _add_slip(commands: Any) -> argparse.ArgumentParser:
    p: argparse.ArgumentParser = commands.add_parser(
        "slip", help="alarms when the tool slides, and none when it does not"
    )
    p.add_argument("--scenario", default="long_cylinder", help="what is held, and by which camera it is seen")
    p.add_argument("--slips", type=whole(0), default=40, help="how many slips")
    p.add_argument("--minutes", type=number(0.0, "min"), default=10.0, help="of ordinary manipulation for false alarms")
    p.add_argument("--membranes", action="store_true", help="between membranes with mechanics, others for each pull")
    p.set_defaults(run=_slip)
    return p


def _add_map(commands: Any) -> argparse.ArgumentParser:
    p: argparse.ArgumentParser = commands.add_parser(
        "map",
        help="which function of what the membranes do gives the wrench",
    )
    p.add_argument("--membranes", type=whole(1), default=20, help="how many, the first drawn from --seed")
    errors = p.add_mutually_exclusive_group()
    errors.add_argument(
        "--images",
        action="store_true",
        help="the estimator itself, on images, in the identification and after it; some minutes each",
    )
    errors.add_argument(
        "--noise",
        type=number(0.0, "1"),
        default=0.0,
        help="errors of the membranes' motion, as a share of the estimator's, which validate band measures",
    )
    p.add_argument("--out", type=Path, metavar="FOLDER", help="keep each membrane's scores, and go on from there")
    p.set_defaults(run=_map)
    return p


def _add_faults(commands: Any) -> argparse.ArgumentParser:
    p: argparse.ArgumentParser = commands.add_parser(
        "faults", help="the controller in closed loop with something wrong: force, way and reason"
    )
    p.add_argument("--runs", type=whole(1), default=500, help="how many, of every kind in turn")
    p.add_argument("--kind", choices=KINDS, action="append", help="only this kind; may be given more than once")
    p.add_argument("--law", choices=LAWS, default="seed", help=LAW_HELP)
    p.add_argument("--out", type=Path, metavar="FILE", help="keep each run as a line of JSON, and go on from there")
    p.set_defaults(run=_faults)
    return p


def _add_grip(commands: Any) -> argparse.ArgumentParser:
    p: argparse.ArgumentParser = commands.add_parser(
        "grip", help="pulls at grasps on membranes: what breaks with the grip that answers slip"
    )
    p.add_argument("--runs", type=whole(1), default=20, help="of each kind, the first drawn from --seed")
    p.add_argument("--kind", choices=PULLS, action="append", help="only this kind; may be given more than once")
    p.set_defaults(run=_grip)
    return p


def _add_surfaces(commands: Any) -> argparse.ArgumentParser:
    p: argparse.ArgumentParser = commands.add_parser(
        "surfaces", help="a task along surfaces that nobody drew: force along the true normal"
    )
    p.add_argument("--runs", type=whole(1), default=20, help="how many, of every kind in turn, each another seed")
    p.add_argument("--kind", choices=SCENARIOS, action="append", help="only this kind; may be given more than once")
    p.add_argument("--task", default="follow", help="name or file of a task along a surface")
    p.add_argument("--out", type=Path, metavar="FILE", help="keep each run as a line of JSON, and go on from there")
    p.set_defaults(run=_surfaces)
    return p


def _add_gel(commands: Any) -> argparse.ArgumentParser:
    p: argparse.ArgumentParser = commands.add_parser(
        "gel", help="two GelSight-class gels, and one alone, over drawn tools and poses"
    )
    p.add_argument("--draws", type=whole(1), default=20, help="how many, the first being --seed")
    p.set_defaults(run=_gel)
    return p


def _add_band(commands: Any) -> argparse.ArgumentParser:
    p: argparse.ArgumentParser = commands.add_parser(
        "band", help="how far off the estimator's motion of the membranes is, on their images"
    )
    p.add_argument("--membranes", type=whole(1), default=10, help="how many, the first drawn from --seed")
    p.set_defaults(run=_band)
    return p


def _estimator(options: argparse.Namespace) -> int:
    if why := _left_out(options):
        raise SeedError(why)
    scenario, name = load_scenario(options.scenario, *run.FOLDERS), options.scenario
    if options.world == "hidden":
        draws = range(options.seed, options.seed + options.draws)
        result = worlds.score_worlds(scenario, options.method, draws, options.jobs)
        print(to_json(result) if options.json else worlds.table(result))
        return 0
    if options.membrane is not None:
        scenario = run.between_membranes(scenario, options.membrane, options.larger)
    if options.bag is not None:
        from seed_testing.validation.bag import run_bag

        series, name = run_bag(options.bag, options.method, scenario), str(options.bag)
        result = scores(series)
    elif options.renderer == "other":
        series = run_other(scenario, options.method, options.seed, options.astray)
        result = scores(series, scenario.trajectory.score_from)
    else:
        series = run.run(scenario, options.method, options.seed)
        result = scores(series, scenario.trajectory.score_from)
    result = {"method": options.method, "scenario": name, "seed": options.seed, **result}
    if series.sliding:
        slid = {"mean": float(np.mean(series.sliding)), "max": float(np.max(series.sliding))}
        stuck = replace(series, estimates=[e.of_patches() for e in series.estimates])
        by_patches = scores(stuck, scenario.trajectory.score_from)
        result |= {"membrane": options.membrane, "sliding_share": slid}
        result |= {"of_patches": {k: by_patches[k] for k in ("rmse", "nees")}}
    if options.report is not None:
        result["report"] = str(draw({options.method: series}, options.report, name))
    print(json.dumps(result, indent=2) if options.json else _table(result))
    return 0


def _left_out(options: argparse.Namespace) -> str:
    """Why an option of `estimator` would have no effect, and what to do; '' if all have one."""
    other = options.renderer == "other"
    if options.world == "hidden":
        if options.bag is not None or options.report is not None:
            return "--from and --report are of one run: leave out --world hidden"
        if options.membrane is not None or other or options.astray:
            return "--membrane, --renderer and --astray are of one run: leave out --world hidden"
        return ""
    if options.bag is not None and (options.membrane is not None or other):
        return "--membrane and --renderer are of rendered images: leave out --from"
    if other and options.membrane is not None:
        return "--membrane is of the own renderer: leave out --renderer other"
    if options.larger != 1.0 and options.membrane is None:
        return "--larger is of a tool on membranes: give --membrane SEED"
    if options.astray and not other:
        return "--astray is of the other renderer: give --renderer other"
    return ""


def _slip(options: argparse.Namespace) -> int:
    scenario = load_scenario(options.scenario, *run.FOLDERS)
    if options.membranes:
        scenario = on_membrane(scenario, options.seed)
    result = slip.alarms(scenario, options.seed, options.slips, options.minutes, options.jobs)
    print(json.dumps(result, indent=2))
    return 0


def _grip(options: argparse.Namespace) -> int:
    cases = pulled.score(options.runs, options.seed, options.kind or PULLS, options.jobs)
    result = pulled.summary(cases)
    each = {"seed": options.seed, **result, "each": pulled.told(cases)}
    print(to_json(each) if options.json else pulled.table(result))
    return 0


def _band(options: argparse.Namespace) -> int:
    result = band.scores(range(options.seed, options.seed + options.membranes), options.jobs)
    print(to_json(result) if options.json else band.table(result))
    return 0 if result["scored"] else 1


def _map(options: argparse.Namespace) -> int:
    seeds = range(options.seed, options.seed + options.membranes)
    noise = None if options.images else options.noise
    result = score.score_membranes(seeds, noise, options.jobs, options.out)
    print(to_json(result) if options.json else score.table(result))
    return 0


def _gel(options: argparse.Namespace) -> int:
    result = gel.score_draws(options.seed, options.draws, options.jobs)
    print(to_json(result) if options.json else gel.table(result))
    return 0


def _faults(options: argparse.Namespace) -> int:
    outcomes = campaign(options.runs, options.seed, options.kind or KINDS, options.law, options.jobs, options.out)
    result = summary(outcomes)
    runs = [o.told() for o in outcomes]
    print(to_json({"seed": options.seed, **result, "each": runs}) if options.json else table(result))
    return int(result["all"]["failed"] > 0)


def _surfaces(options: argparse.Namespace) -> int:
    runs = surfaces(options.runs, options.seed, options.kind or SCENARIOS, options.task, options.jobs, options.out)
    result = summary_of_surfaces(runs)
    print(to_json({"seed": options.seed, **result, "each": runs}) if options.json else table_of_surfaces(runs))
    return int(result["beyond"] > 0)


def _table(result: dict[str, Any]) -> str:
    lines = [f"{result['method']}, {result['scenario']}, seed {result['seed']}: "
             f"{100 * result['valid_fraction']:.1f} % of {result['frames']} frames valid"]  # fmt: skip
    if result["nees"] is not None:
        lines.append(f"{'':10}{'rmse':>9}{'bias':>9}{'gain':>9}{'corr.':>9}")
        for name in NAMED:
            axis = name.split("_")[0]
            values = (result["rmse"][name], result["bias"][name], result["gain"][axis], result["correlation"][axis])
            lines.append(f"{name:10}" + "".join("      ---" if v is None else f"{v:9.3f}" for v in values))
        low, high = result["nees_bounds"]
        lines.append(f"normalised error squared {result['nees']:.2f} (6 expected; bounds {low:.2f} to {high:.2f})")
    if "sliding_share" in result:
        slid = result["sliding_share"]
        lines.append(f"sliding nodes {100 * slid['mean']:.0f} % on average, {100 * slid['max']:.0f} % at most")
        if (off := result["of_patches"])["nees"] is not None:
            rms = " ".join(f"{off['rmse'][n]:.3f}" for n in NAMED)
            lines.append(f"of the patches instead of the tool: rmse {rms}, normalised error squared {off['nees']:.1f}")
    cost = result["ms_per_pair"]
    lines.append(f"CPU per pair {cost['median'] or 0:.2f} ms median, {cost['p99'] or 0:.2f} ms at 99 %")
    if result.get("report"):
        lines.append(f"figure: {result['report']}")
    return "\n".join(lines)
