# SPDX-License-Identifier: Apache-2.0
"""Share of the wrench that each model leaves unexplained of a motion it never saw, over random membranes."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed

from seed_core.bushing import Bushing, Stiffness
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.membrane.features import by_finger, features
from seed_core.membrane.map import MembraneMap
from seed_core.spatial import Array, inverse_pose, wrench_adjoint
from seed_core.wrench_model import observed_part
from seed_sim.closed_loop.progress import in_parallel
from seed_sysid.membrane.fit import MembraneFit, fit_membrane, rms
from seed_sysid.membrane.result import map_file
from seed_sysid.membrane.terms import DEFAULT_MODEL, MODELS, values
from seed_sysid.stiffness_map import CHANNELS, wrench_transform
from seed_testing.validation.maps.finite_elements import SUMS, FiniteElements
from seed_testing.validation.maps.image_run import run_on_images
from seed_testing.validation.maps.membrane_run import Run, run_membrane

OF_POSE = "pose of the tool"
OF_ELEMENTS = tuple(f"finite elements, {name}" for name in SUMS)
OF_BOTH = f"{OF_ELEMENTS[-1]}, and {DEFAULT_MODEL} of what they leave"
IN_C = f"{DEFAULT_MODEL}, told about C"  # where an error of the tool's pose does not count
ROWS = (OF_POSE, *OF_ELEMENTS, OF_BOTH, *MODELS, IN_C)
SHARES = (0.40, 0.65)  # of the touching nodes that slide
FRAMES = 100


def score_membrane(
    seed: int, shares: tuple[float, ...] = SHARES, noise: float | None = 0.0, frames: int = FRAMES
) -> dict[str, Any]:
    """What is unexplained by motion and model, with the default model's nees; `failed` says why there are none.

    noise: share of the estimator's usual errors; None: the estimator itself, on images.
    """
    try:
        run = run_on_images(seed, shares, frames) if noise is None else run_membrane(seed, shares, noise, frames)
        if run.analysis.membrane is None:
            return {"seed": seed, "failed": run.analysis.membrane_refused}
    except SeedError as error:
        return {"seed": seed, "failed": str(error)}
    return {"seed": seed, "closed_mm": 1e3 * run.closed} | _scored(run)


def _scored(run: Run) -> dict[str, Any]:
    analysis = run.analysis
    assert analysis.membrane is not None
    fit = analysis.membrane.fit
    elements = _Elements(fit, run.elements) if run.elements is not None else None
    files = {m: map_file(_fitted(fit, m), "membrane", "handle", "") for m in MODELS}
    out: dict[str, Any] = {"left_out": {OF_POSE: analysis.left_out_share.tolist(), DEFAULT_MODEL: fit.share.tolist()}}
    out["motions"] = []
    for asked, truth in run.motions.items():
        bushing = Bushing(Stiffness.from_vector(analysis.solution.value.stiffness[analysis.nominal]))
        of_pose = np.array([_by_pose(bushing, e) for e in truth.estimates])
        shares, nees, nees_in_C, doubted = {OF_POSE: _share(of_pose, truth.wrench)}, 0.0, 0.0, 0.0
        if elements is not None and truth.elements is not None:
            for name, told in elements.told(truth.estimates, truth.elements).items():
                shares[name] = _share(told, truth.wrench)
        for name, file in files.items():
            model = MembraneMap(file)
            at_grasp = file.grips[len(file.grips) // 2].pressure_hpa
            model.grasped(at_grasp, at_grasp)
            springs = [model.spring(e) for e in truth.estimates]
            wrench = np.array([t.wrench.vector() for t in springs])
            shares[name] = _share(wrench, truth.wrench)
            if name == DEFAULT_MODEL:
                covariance = np.array([t.covariance for t in springs])
                nees = _nees(wrench - truth.wrench, covariance)
                doubted = float(np.mean([bool(t.reason) for t in springs]))
                to_C = np.array([wrench_adjoint(observed_part(e)) for e in truth.estimates])
                told = np.einsum("nij,nj->ni", to_C, wrench)
                true = np.einsum("nij,nj->ni", [wrench_adjoint(X) for X in truth.X_CT], truth.wrench)
                shares[IN_C] = _share(told, true)
                nees_in_C = _nees(told - true, to_C @ covariance @ np.swapaxes(to_C, 1, 2))
        out["motions"].append(
            {
                "asked": asked,
                "size": truth.size,
                "sliding": truth.sliding,
                "told": truth.told,
                "rms": rms(truth.wrench).tolist(),
                "shares": shares,
                "nees": nees,
                "nees_in_C": nees_in_C,
                "doubted": doubted,
            }
        )
    return out


def _by_pose(bushing: Bushing, estimate: RelativePoseEstimate) -> Array:
    """(6,) load on the tool about T, in T, as the stiffness map tells it by the pose of the patches."""
    wrench = bushing.wrench(inverse_pose(estimate.of_patches().X_CT))
    return wrench.about(estimate.X_PT[:3, 3]).rotated(estimate.X_PT[:3, :3].T).vector()


class _Elements:
    """Finite elements fitted to an identification, alone and with the default model of what they leave."""

    def __init__(self, fit: MembraneFit, changes: Array) -> None:
        """changes: (n, 2, 2, 6) of all samples, as of Run."""
        kept, data, to_C = changes[fit.data.kept], fit.data, fit.data.to_C
        self._elements = FiniteElements.fitted(kept, np.einsum("nij,nj->ni", to_C[data.grip], fit.wrench))
        elements = np.linalg.solve(to_C[data.grip], self._elements.wrench(kept)[-1][:, :, None])[:, :, 0]
        self._of_left = fit_membrane(data._replace(wrench=data.wrench - elements), DEFAULT_MODEL, fit.nuisance)
        middle = len(data.widths) // 2  # the motions' grip
        self._middles, self._to_C = data.middles[middle], to_C[middle]

    def told(self, estimates: list[RelativePoseEstimate], changes: Array) -> dict[str, Array]:
        """(n, 6) load on the tool about T, in T, by name."""
        Z = np.array([features(by_finger(e.membrane), self._middles) for e in estimates])
        alone = self._elements.wrench(changes)
        both = alone[-1] + values(Z, self._of_left.terms) @ (self._to_C @ self._of_left.coefficients(0.0)[0]).T
        to_T = np.array([wrench_transform(inverse_pose(e.X_CT)) for e in estimates])
        by_name = zip((*OF_ELEMENTS, OF_BOTH), (*alone, both), strict=True)
        return {name: np.einsum("nij,nj->ni", to_T, load) for name, load in by_name}


def _fitted(fit: MembraneFit, model: str) -> MembraneFit:
    return fit if model == fit.model else fit_membrane(fit.data, model, fit.nuisance)


def _nees(error: Array, covariance: Array) -> float:
    """Mean normalised square of errors (n, 6) by their covariances (n, 6, 6)."""
    return float(np.mean(np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[:, :, None])[:, :, 0])))


def _share(wrench: Array, true: Array) -> list[float]:
    return (rms(wrench - true) / rms(true)).tolist()  # type: ignore[no-any-return]


def score_membranes(
    seeds: Sequence[int], noise: float | None, jobs: int, folder: Path | None, frames: int = FRAMES
) -> dict[str, Any]:
    """Scores of every membrane, and median, 90 % and worst over them; finished ones are kept in the folder, if any.

    noise: as of `score_membrane`.
    """
    calls = [delayed(_kept)(s, noise, frames, folder) for s in seeds]
    runs = list(in_parallel(calls, jobs, "membrane"))
    good = [r for r in runs if "failed" not in r]
    summary = []
    for i, asked in enumerate(SHARES if good else ()):
        mine = [r["motions"][i] for r in good]
        told = [m for m in ROWS if all(m in r["shares"] for r in mine)]  # scores kept from before may lack some
        models = {m: _spread(np.array([r["shares"][m] for r in mine])) for m in told}
        nees = np.array([r["nees"] for r in mine])
        summary.append(
            {
                "asked": asked,
                "size": _spread(np.array([[r["size"]] for r in mine])),
                "sliding": _spread(np.array([[r["sliding"]] for r in mine])),
                "doubted": float(np.mean([r["doubted"] for r in mine])),
                "told": float(np.mean([r.get("told", 1.0) for r in mine])),
                "shares": models,
                "nees": _spread(nees[:, None]),
                "nees_in_C": _spread(np.array([[r.get("nees_in_C", np.nan)] for r in mine])),
            }
        )
    return {"membranes": len(runs), "scored": len(good), "noise": noise, "summary": summary, "runs": runs}


def _kept(seed: int, noise: float | None, frames: int, folder: Path | None) -> dict[str, Any]:
    errors = "images" if noise is None else f"{noise:g}"
    file = folder / f"membrane-{seed}-{errors}-{frames}.json" if folder is not None else None
    if file is not None and file.exists():
        return dict(json.loads(file.read_text(encoding="utf-8")))
    result = score_membrane(seed, SHARES, noise, frames)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(result), encoding="utf-8")
    return result


def _spread(values: Array) -> dict[str, list[float]]:
    """Median, 90 % and worst over the rows."""
    return {
        "median": np.median(values, axis=0).tolist(),
        "90 %": np.quantile(values, 0.9, axis=0).tolist(),
        "worst": values.max(axis=0).tolist(),
    }


def _three(spread: dict[str, list[float]]) -> str:
    return f"{spread['median'][0]:.1f} (90 % {spread['90 %'][0]:.1f}, worst {spread['worst'][0]:.1f})"


def table(result: dict[str, Any]) -> str:
    """The comparison, in words."""
    noise = result["noise"]
    seen = "as the estimator sees them" if noise is None else f"features with {noise:g} of the usual noise"
    lines = [f"{result['scored']} of {result['membranes']} membranes; {seen}"]
    if closed := [r for r in result["runs"] if r.get("closed_mm")]:
        how = ", ".join(f"{r['seed']} by {r['closed_mm']:.0f} mm" for r in closed)
        lines.append(f"gripped harder, since the first grip could not be identified: {how}")
    for part in result["summary"]:
        sliding, nees = part["sliding"], part["nees"]
        size, told = part["size"]["median"][0], f"{_three(nees)}, told about C {_three(part['nees_in_C'])}"
        lines.append(
            f"{sliding['median'][0]:.0%} of the nodes slide ({part['asked']:.0%} asked; motions of {2 * size:.1f} mm "
            f"and {4 * size:.1f} deg rms); nees {told}; beyond what was identified: {part['doubted']:.0%} of the frames"
            + (f"; not told, and not scored: {1.0 - part['told']:.0%}" if part["told"] < 1.0 else "")
        )
        lines.append(f"  {'unexplained [%], median / 90 % / worst':<40}" + "".join(f"{c:>17}" for c in CHANNELS))
        for name, shares in part["shares"].items():
            cells = zip(shares["median"], shares["90 %"], shares["worst"], strict=True)
            lines.append(
                f"  {name:<40}" + "".join(f"{100 * a:5.1f} {100 * b:5.1f} {100 * c:5.1f}" for a, b, c in cells)
            )
    lines += [f"membrane {r['seed']} failed: {r['failed']}" for r in result["runs"] if "failed" in r]
    return "\n".join(lines)
