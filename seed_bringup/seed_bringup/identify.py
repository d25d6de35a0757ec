# SPDX-License-Identifier: Apache-2.0
"""./seed identify: the stiffness of a grasp, from a simulated run or from recorded data."""

import argparse
import json
import sys
from dataclasses import replace
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from seed_bringup.commands.cells import cell_arguments, in_root, join
from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command, results_folder, seed_number, whole
from seed_sim.identification.scenario import identify_on_membrane, load
from seed_sim.identification.session import simulate
from seed_sim.identification.truth import compare_in_the_loop, summary_with_truth
from seed_sysid.data.dataset import SOURCES
from seed_sysid.data.sample_file import read
from seed_sysid.fit.analysis import Analysis, analyse
from seed_sysid.parameters import FitParameters
from seed_sysid.report.summary import stiffness_file, summary
from seed_sysid.stiffness_map import AXES, UNITS


@command("seed identify")
def main(argv: list[str]) -> int:
    """Run the command; 0 when a stiffness was found, 1 when an axis is not determined."""
    return _run(parser().parse_args(argv))


SIMULATED = "a simulated run"
WAYS = {  # what each takes beside --json
    SIMULATED: ("scenario", "seed", "world", "poses", "model", "in_the_loop", "out"),
    "--membrane": ("membrane", "scenario", "seed", "world", "poses", "model", "out"),
    "--procedure weight": ("scenario", "seed", "world", "model"),
    "--procedure weight --membrane": ("membrane", "scenario", "seed", "world"),
    "--procedure weight --from": ("hand", "model", "out"),
    "--from": ("poses", "model", "out"),
    "--world hidden": ("world", "seed", "draws"),
    "--live": ("domain", "namespace", "poses", "zero_sensor", "out"),
}
DEFAULTS = {"scenario": "default", "seed": 0, "poses": "kinematic", "draws": 20, "namespace": ""}


def parser() -> argparse.ArgumentParser:
    """The command line; an option that is not given is None or False."""
    out = Parser(prog="seed identify", description=__doc__)
    out.add_argument("--scenario", help="YAML file, or a name in seed_sim/config/identify (default: default)")
    out.add_argument("--seed", type=seed_number, help="draws the hidden stiffness and every fault (default: 0)")
    out.add_argument(
        "--membrane",
        type=seed_number,
        metavar="SEED",
        help="hold the tool between two membranes with mechanics, drawn from this seed (docs/membrane.md)",
    )
    out.add_argument("--poses", choices=SOURCES, help="source of the poses (default: kinematic)")
    out.add_argument(
        "--procedure",
        choices=("sensor", "weight"),
        default="sensor",
        help="weight: without a force sensor, by a known weight in known attitudes; with --membrane as images show it",
    )
    out.add_argument("--model", choices=("midpoint", "plain"), help="stiffness map to fit; default: the scenario's")
    out.add_argument(
        "--from",
        dest="source",
        type=Path,
        metavar="PATH",
        help="fit recorded samples (a run's folder, its file or a bag) again; "
        "with --procedure weight: a bag of current_pose and relative_pose",
    )
    out.add_argument("--hand", metavar="FILE", help="with --procedure weight --from: hand_file, with the tool's mass")
    out.add_argument("--world", choices=("known", "hidden"), help="hidden: see docs/worlds.md (default: known)")
    out.add_argument(
        "--draws", type=whole(1), help="of hidden worlds, the first being --seed; the grasp of `nominal` (default: 20)"
    )
    out.add_argument("--live", action="store_true", help="on the running cell, by the node sysid; Ctrl-C cancels")
    cell_arguments(out)
    out.set_defaults(namespace=None)
    out.add_argument(
        "--zero-sensor",
        action="store_true",
        help="with --live: zero the sensor first; a run that goes on keeps its zero",
    )
    out.add_argument("--in-the-loop", action="store_true", help="also wipe a table with the result, against the truth")
    out.add_argument(
        "--out",
        type=Path,
        help="folder for data, stiffness.yaml and report.html; default: results/identify-TIME; "
        "an interrupted run whose folder it names goes on",
    )
    out.add_argument(
        "--json", action="store_true", help="print one JSON object; without --out and --live nothing is left behind"
    )
    return out


def _run(args: argparse.Namespace) -> int:
    _refuse_what_would_be_ignored(args)
    for name, value in DEFAULTS.items():
        if getattr(args, name) is None:
            setattr(args, name, value)
    if args.world == "hidden":
        return _worlds(args)
    if args.procedure == "weight":
        return _weight(args)
    if args.live:
        return _live(args)
    now = datetime.now(UTC)
    date, folder = now.isoformat(timespec="seconds"), args.out
    if folder is None and not args.json:
        folder = _folder_of(now)
    analysis, figures = _from_file(args) if args.source else _simulated(args, folder, date)
    if folder is not None:
        from seed_sysid.report.results import write_results

        write_results(folder, analysis, figures, date)
    print(json.dumps(figures) if args.json else _table(analysis, figures, folder))
    return 1 if analysis.undetermined else 0


def _refuse_what_would_be_ignored(args: argparse.Namespace) -> None:
    way = _way(args)
    given = {k for k, v in vars(args).items() if v is not None and v is not False}
    ignored = [k for k in sorted(given - {"procedure", "source", "live", "json"}) if k not in WAYS[way]]
    if ignored:
        takes = ", ".join(_option(k) for k in WAYS[way] if _option(k) not in way)
        raise SeedError(f"{way} takes {takes} and --json: leave {' and '.join(map(_option, ignored))} out")


def _way(args: argparse.Namespace) -> str:
    """The key of WAYS. Raises SeedError: more than one is asked for."""
    asked = {
        "--live": args.live,
        "--world hidden": args.world == "hidden",
        "--procedure weight": args.procedure == "weight",
        "--from": args.source is not None,
    }
    ways = [way for way, wanted in asked.items() if wanted]
    if ways == ["--procedure weight", "--from"]:
        ways = [" ".join(ways)]
    if len(ways) > 1:
        raise SeedError(f"{ways[0]} and {ways[1]} exclude each other: leave one of the two out")
    if args.membrane is None:
        return ways[0] if ways else SIMULATED
    on_membranes = " ".join([*ways, "--membrane"])
    return on_membranes if on_membranes in WAYS else ways[0]


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _folder_of(now: datetime) -> Path:
    return results_folder() / f"identify-{now:%Y%m%d-%H%M%S}"


def _live(args: argparse.Namespace) -> int:
    folder = args.out or _folder_of(datetime.now(UTC))
    then = f"if it is interrupted, --out {folder} goes on"
    if (folder / "samples.jsonl").exists():
        then = "the run that has samples there goes on; a new grasp wants another folder"
    print(f"seed identify: {join(args)}", file=sys.stderr)
    print(f"seed identify: results go to {folder}; {then}", file=sys.stderr, flush=True)
    client = import_module("seed_sysid.ros.client")  # ROS, only where it is needed
    figures = client.identify(folder, args.poses, args.zero_sensor, in_root(args.namespace))
    print(json.dumps(figures) if args.json else client.table(figures, folder))
    return 0 if figures["stiffness_file"] else 1


def _worlds(args: argparse.Namespace) -> int:
    from seed_sim.world.procedures import identify

    result = identify.identify_draws(range(args.seed, args.seed + args.draws))
    print(json.dumps(result) if args.json else identify.table(result))
    return 0


def _weight(args: argparse.Namespace) -> int:
    from seed_bringup import identify_weight

    if args.source:
        if args.hand is None:
            raise SeedError("--procedure weight --from wants --hand: the hand_file, with the tool's mass in it")
        folder = args.out or (None if args.json else _folder_of(datetime.now(UTC)))
        words, figures, whole = identify_weight.recorded(args.source, args.hand, args.model or "midpoint", folder)
    elif args.membrane is not None:
        words, figures, whole = identify_weight.simulated_on_membranes(args.scenario, args.membrane, args.seed)
    else:
        words, figures, whole = identify_weight.simulated(args.scenario, args.seed, args.model)
    print(json.dumps(figures) if args.json else words)
    return 0 if whole else 1


def _six(halves: dict[str, list[float]]) -> list[float]:
    return [*halves["rotation"], *halves["translation"]]


def _simulated(args: argparse.Namespace, folder: Path | None, date: str) -> tuple[Analysis, dict[str, Any]]:
    scenario = load(args.scenario)
    if args.membrane is not None:
        scenario = identify_on_membrane(scenario, args.membrane)
    fit = replace(scenario.procedure.fit, model=args.model) if args.model else scenario.procedure.fit
    pose_source = None
    if args.poses == "estimator":
        from seed_sim.identification.tactile_poses import TactilePoses

        pose_source = TactilePoses(scenario, args.seed)
    file = folder / "samples.jsonl" if folder else None
    data, cell = simulate(scenario, args.seed, file, pose_source, date)
    analysis = analyse(data, args.poses, fit)
    figures = summary_with_truth(analysis, cell.truth) | {
        "scenario": scenario.name,
        "seed": args.seed,
        "simulated_minutes": cell.stamp / 60.0,
        "outliers_made": cell.outliers,
    }
    if args.in_the_loop:
        g = analysis.nominal
        true = cell.truth.stiffness[analysis.grips[g]]
        figures["in_the_loop"] = compare_in_the_loop(
            stiffness_file(analysis, date), float(analysis.widths[g]), true, args.seed
        )
    return analysis, figures


def _from_file(args: argparse.Namespace) -> tuple[Analysis, dict[str, Any]]:
    data = read(args.source)
    analysis = analyse(data, args.poses, FitParameters(model=args.model or "midpoint"))
    minutes = (data.samples[-1].stamp - data.samples[0].stamp) / 60.0
    return analysis, summary(analysis) | {"from": str(args.source), "minutes": minutes}


def _table(a: Analysis, figures: dict[str, Any], folder: Path | None) -> str:
    g = a.nominal
    lines = [f"stiffness at {1e3 * a.widths[g]:.1f} mm ({figures['confidence']:.0%} intervals, {a.source} poses):"]
    for j, (axis, unit) in enumerate(zip(AXES, UNITS, strict=True)):
        k, half = a.solution.value.stiffness[g, j], a.solution.half_width[g, j]
        true = _six(figures["truth"])[j] if "truth" in figures else None
        note = f"   true {true:9.3f}  error {abs(k / true - 1):6.2%}" if true else ""
        lines.append(f"  {axis:<6}{k:9.3f} +- {half:7.3f} {unit:<8}{note}")
    if figures.get("membrane_map"):
        lines.append("membrane map, load over the motion of the material (95 % intervals; all terms: --json):")
        for (axis, (k, half)), unit in zip(figures["membrane_map"]["slopes"].items(), UNITS, strict=True):
            lines.append(f"  {axis:<6}{k:9.3f} +- {half:7.3f} {unit}")
    if "in_the_loop" in figures:
        loop = figures["in_the_loop"]
        errors = [f"{name} {score['rmse']:.4f} N" for name, score in loop["force_z"].items()]
        lines.append(f"squeegee, rms force error: {', '.join(errors)} (allowed {loop['allowed_rmse']:.4f} N)")
    lines += [f"warning: {w}" for w in a.warnings]
    if folder is not None:
        left = sorted(f.name for f in folder.iterdir())
        lines.append(f"left in {folder}: {', '.join(left)}")
    return "\n".join(lines)
