# SPDX-License-Identifier: Apache-2.0
"""What an identification says of the membrane map: its file and figures, what hysteresis and curvature are due to."""

from typing import Any

import numpy as np

from seed_core.membrane.features import SCALES
from seed_core.membrane.map import MembraneMap
from seed_core.membrane.map_file import PRODUCT, GripMap, MembraneMapFile, format_rows, term_names
from seed_core.spatial import Array
from seed_sysid.membrane.data import refuse_idle
from seed_sysid.membrane.fit import MembraneFit, fit_membrane, grip_coordinate, rms
from seed_sysid.membrane.terms import DEFAULT_MODEL, MAIN, MODELS, indices, values
from seed_sysid.stiffness_map import AXES, CHANNELS, LOAD_UNITS

_LEAST_STD = np.array([1e-5] * 3 + [1e-4] * 3)  # [N m, N]
_REMAINS = 0.35  # share of the hysteresis against the tool's pose that makes the material hysteretic itself
_CURVED = 1.3  # times the smooth model's error that a linear one leaves
_LINEAR = "with deformation"
_EXCITED = 0.08  # [scale] rms that each motion of the tool should have: 0.3 deg, 0.16 mm
_SHOWN = 0.05  # share of a component of the wrench; where less is left, a smaller motion was enough


def map_file(fit: MembraneFit, hand: str, tool: str, date: str) -> MembraneMapFile:
    """membrane_map.yaml of a fit; date in ISO 8601.

    Raises:
        ConfigError: no map that can be used, such as one with a stiffness that is not positive.
    """
    data, spread, follow, to_C = fit.data, fit.spread(), fit.follow(), fit.data.to_C
    leverage = ((values(data.Z, fit.terms) @ spread.T) ** 2).sum(axis=1)
    # The map adds the coefficients' share to this one's; the errors of paths left out have both.
    unseen = np.einsum("nij,nj->ni", to_C[data.grip], fit.unseen)
    std = np.maximum(rms(unseen) / np.sqrt(1.0 + leverage.mean()), _LEAST_STD)
    gas_std = rms(np.array([c.unseen for c in fit.gas]).T) if fit.gas else np.zeros(2)
    grips = []
    for i in np.argsort(-data.widths):
        coefficients, gas = fit.coefficients(float(grip_coordinate(data.widths)[i]))
        (left, right), pressure = data.middles[i].tolist(), float(data.pressures[i])
        grips.append(
            GripMap(
                pressure_hpa=pressure if np.isfinite(pressure) else 0.0,
                width_m=float(data.widths[i]),
                left_middle=tuple(left),
                right_middle=tuple(right),
                torque_std=tuple(std[:3].tolist()),
                force_std=tuple(std[3:].tolist()),
                coefficients=format_rows(to_C[i] @ coefficients),
                spread=format_rows(spread),
                follow=format_rows(follow),
                pressure_rise=format_rows(gas) if len(gas) else (),
                pressure_std=(float(gas_std[0]), float(gas_std[1])),
            )
        )
    file = MembraneMapFile(
        hand=hand,
        tool=tool,
        date=date,
        scales=tuple(SCALES.tolist()),
        terms=term_names(indices(fit.terms)),
        largest=tuple(np.abs(data.Z).max(axis=0).round(6).tolist()),
        leverage=float(leverage.max()),
        grips=tuple(grips),
        motion=float((data.Z[:, list(MAIN)] ** 2).sum(axis=1).mean()),
    )
    for grip in file.grips:
        MembraneMap(file, grip)  # refuses a stiffness that is not positive
    return file


def refuse_unexcited(fit: MembraneFit) -> None:
    """Raises DatasetError where the membranes hardly moved and the map does not tell the load of paths it has not seen.

    A stiff grasp moves little along y before it meets the force limit, and may tell that force all the same.
    """
    left = rms(fit.unseen) / np.maximum(rms(fit.wrench), 1e-12)
    refuse_idle(fit.data.Z, np.where(left > _SHOWN, _EXCITED, 0.0))


def stiffness_at_rest(file: MembraneMapFile) -> Array:
    """(6,) [N m/rad, N/m] local stiffness at the middle grip, where patches stick."""
    return MembraneMap(file).stiffness.vector()


def coefficients(fit: MembraneFit) -> dict[str, dict[str, tuple[float, float]]]:
    """At the middle grip, by component and term: value and half width of its 95 % interval [N m or N, terms in scales].

    Of products only those whose interval leaves 0 out; of linear terms all.
    """
    out = {}
    for channel, component in zip(CHANNELS, fit.components, strict=True):
        values, halves = component.coefficients(0.0), component.half_widths()
        names = term_names(indices(values))
        told = {name: (values[t], halves[t]) for name, t in zip(names, values, strict=True)}
        out[channel] = {n: (v, h) for n, (v, h) in told.items() if PRODUCT not in n or abs(v) > h}
    return out


def slopes(fit: MembraneFit) -> tuple[Array, Array]:
    """(6,) load over the motion of the material along roll, pitch, yaw, x, y, z [N m/rad, N/m], and its half width."""
    scales, terms = SCALES[list(MAIN)], [(i,) for i in MAIN]
    value = [-c.coefficients(0.0)[t] for c, t in zip(fit.components, terms, strict=True)]
    half = [c.half_widths()[t] for c, t in zip(fit.components, terms, strict=True)]
    return np.array(value) / scales, np.array(half) / scales


def compare_models(fit: MembraneFit) -> dict[str, Array]:
    """(6,) share of the wrench that each model leaves unexplained of samples that it did not see."""
    names = [m for m in MODELS if fit.data.with_pressure or "pressure" not in " ".join(MODELS[m])]
    return {m: fit.share if m == fit.model else fit_membrane(fit.data, m, fit.nuisance).share for m in names}


def curvature(shares: dict[str, Array]) -> tuple[str, ...]:
    """Where a linear map is not enough, in words."""
    linear, smooth = shares[_LINEAR], shares[DEFAULT_MODEL]
    return tuple(
        f"{name} is nonlinear: of the membranes' motion a linear map leaves {a:.0%} unexplained, a smooth one {b:.0%}"
        for name, a, b in zip(CHANNELS, linear, smooth, strict=True)
        if a > _CURVED * b
    )


def remaining_hysteresis(fit: MembraneFit, B: Array, z: Array) -> Array:
    """(6,) [N m, N] friction along each axis that is left against the motion of the material.

    Args:
        fit: of the map.
        B: (n, 6, 6) of generalised forces to wrenches, as `stiffness_map` gives them.
        z: (n, 6) states of friction at the samples.
    """
    load = np.linalg.solve(B, fit.data.to_C[fit.data.grip] @ fit.left_out[:, :, None])[:, :, 0]
    power = (z**2).sum(axis=0)
    return np.asarray((z * load).sum(axis=0) / np.maximum(power, 1e-9))


def causes(hysteretic: tuple[int, ...], friction: Array, remaining: Array) -> tuple[str, ...]:
    """What the hysteresis of each hysteretic axis comes from, in words.

    Args:
        hysteretic: axes. friction: (6,) against the tool's pose; remaining: (6,) against the material's motion.
    """
    out = []
    for j in hysteretic:
        before, after, unit = 2.0 * abs(float(friction[j])), 2.0 * abs(float(remaining[j])), LOAD_UNITS[j]
        where = (
            "friction between patch and tool, of which the wrench from the membranes is free"
            if after < _REMAINS * before
            else "the material itself (viscous or hysteretic rubber): the wrench from the membranes has it as well"
        )
        out.append(
            f"{AXES[j]}: loading and unloading differ by {before:.3g} {unit} against the tool's pose and "
            f"{after:.3g} {unit} against the membranes' motion: {where}"
        )
    return tuple(out)


def figures(
    fit: MembraneFit, shares: dict[str, Array], remarks: tuple[str, ...], file: MembraneMapFile
) -> dict[str, Any]:
    """All as plain data."""

    def channels(six: Array) -> dict[str, float]:
        return dict(zip(CHANNELS, np.asarray(six).tolist(), strict=True))

    return {
        "model": fit.model,
        "samples": len(fit.left_out),
        "terms": len(fit.terms),
        "left_out_rms": channels(rms(fit.left_out)),
        "left_out_rms_by_path": channels(rms(fit.unseen)),
        "left_out_share": channels(fit.share),
        "left_out_share_by_model": {name: channels(share) for name, share in shares.items()},
        "slopes": _with_intervals(*slopes(fit)),
        "coefficients": coefficients(fit),
        "stiffness_at_rest": dict(zip(AXES, stiffness_at_rest(file).tolist(), strict=True)),
        "frame_offset": {
            "rotation_deg": np.rad2deg(fit.nuisance[-6:-3]).tolist(),
            "translation_mm": (1e3 * fit.nuisance[-3:]).tolist(),
        },
        "remarks": list(remarks),
    }


def _with_intervals(value: Array, half: Array) -> dict[str, tuple[float, float]]:
    return {axis: (float(v), float(h)) for axis, v, h in zip(AXES, value, half, strict=True)}
