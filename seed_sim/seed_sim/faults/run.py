# SPDX-License-Identifier: Apache-2.0
"""One run with a fault, and what it came to: worst force, free way, and whether a reason was told."""

from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from seed_control.controller import ControlRefusedError
from seed_control.setpoint.setpoints import HybridSetpoint, SetpointError
from seed_control.state import ControllerState
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, rotation_from_rpy
from seed_sim.closed_loop.run import SETTLE, SeedSteering
from seed_sim.faults.draw import Fault, draw
from seed_sim.faults.poses import FaultyPoses
from seed_sim.plant.arm import MovingTable
from seed_sim.plant.plant import Plant
from seed_sim.scenario import Scenario, load_scenario

DURATION = 7.0  # [s] of a run
WORK = make_pose(None, (0.45, 0.0, 0.0))  # X_W_work, above the nominal table
_START = 0.012  # [m] of the tip above it
_WIPES = 2.2  # [s] from which on it wipes
_AFTER = 1.0  # [s] after a hold, at which an operator enables again ...
_LEFT = 2.5  # [s] ... if so much is left
_WINDOW = 0.1  # [s] that a force has to last to count
_TOUCHES = 0.5  # share of the wanted force along a direction from which on a way in it is not free
_SERVED = 0.2, 0.5  # share of the wanted force, and [N], within which its error over the last second needs no reason


class Outcome(NamedTuple):
    """What a run came to.

    Attributes:
        excess: [N] by which the true force along the wanted one was above it for longer than 0.1 s at a time, at most.
        norm: [N] the same of the force's size, whatever its direction: friction and side forces count as well.
        peak: [N] as `excess`, however shortly.
        travel: [m] free way of the tip along a force direction, at most.
        served: the force was the wanted one at the end.
        reason: what the state told at the end; held: why it held first.
    """

    fault: Fault
    excess: float
    norm: float
    peak: float
    travel: float
    served: bool
    reason: str
    held: str

    @property
    def silent(self) -> bool:
        """Not served, and no word of why."""
        return not self.served and not self.reason

    def told(self) -> dict[str, Any]:
        """The run as an object of JSON."""
        f, wanted = self.fault, [round(v, 3) for v in self.fault.force.tolist()]
        return {"kind": f.kind, "seed": f.seed, "force": wanted, **{n: getattr(self, n) for n in self._fields[1:]}}


def run_fault(kind: str, seed: int, law: str = "seed") -> Outcome:
    """One run of that kind, drawn from the seed."""
    return _Run(draw(kind, seed), law).outcome()


class _Run:
    def __init__(self, fault: Fault, law: str) -> None:
        self._fault = fault
        scenario = load_scenario("nominal")
        self._scenario: Scenario = replace(scenario, table=replace(scenario.table, edge=fault.edge))
        X_WT = WORK @ make_pose(rotation_from_rpy((np.pi, 0.0, 0.0)), (0.0, 0.0, _START))
        self._X_tip = X_WT
        X_WE = X_WT @ inverse_pose(scenario.tool.X_Ttip) @ inverse_pose(scenario.hand.X_EC)
        self._plant = Plant(self._scenario, fault.seed, WORK, X_WE)
        if fault.kind == "moving table":
            arm = self._plant.arm
            arm.error = MovingTable(arm.error, fault.amplitude, fault.frequency, fault.since)
        self._steering = SeedSteering(
            self._plant, self._scenario, law, "noisy", fault.seed, FaultyPoses(self._scenario, fault)
        )
        self._setpoint = HybridSetpoint(
            X_WT,
            Wrench(np.zeros(3), fault.force),
            np.diag((fault.force != 0.0).astype(float)),
            (fault.torque_x, False, False),
            contact_resists=(fault.torque_x, False, False),
        )
        self._enabled_again = not fault.again
        self._held, self._held_at = "", np.inf
        self._again_at = 0.0  # [s] when it was enabled once more
        self._asked = False  # the set-point was taken since it was enabled

    def outcome(self) -> Outcome:
        forces, places, states = [], [], []
        for i in range(round(DURATION * self._steering.rate)):
            t = i / self._steering.rate
            state = self._step(t)
            forces.append(self._plant.contact_wrench.force)
            places.append((self._plant.X_WT @ self._plant.tool.X_Ttip)[:3, 3])
            states.append(state)
        return self._judge(np.array(forces), np.array(places), states)

    def _step(self, t: float) -> ControllerState:
        """Sense, ask, steer."""
        fault, steering = self._fault, self._steering
        state, core = steering.sense(t), steering.controller
        if fault.kind == "arm holds" and t >= fault.since:
            self._plant.arm.holds = True
        if state.mode == "holding" and not self._held:
            self._held, self._held_at = state.reason, t
        soon = self._held_at + _AFTER <= t < DURATION - _LEFT
        if not self._enabled_again and soon and state.mode == "holding":
            self._enabled_again, self._asked = True, False
            self._again_at = t
            try:
                core.enable(t)
            except ControlRefusedError:
                core.disable(t, state.reason)
        if t >= SETTLE + 0.02 and (core.state.mode not in ("holding", "disabled")):
            self._ask(t)
        steering.steer(t, None)
        return core.state

    def _ask(self, t: float) -> None:
        fault, wiped = self._fault, 0.0
        if t > _WIPES:
            wiped = fault.speed * (t - _WIPES)
        X = self._X_tip @ make_pose(None, (wiped, 0.0, 0.0))
        velocity = np.array((fault.speed if wiped else 0.0, 0.0, 0.0))
        if self._asked and not wiped:
            return
        try:
            self._steering.controller.set_setpoint(self._setpoint.moved(X, velocity), t)
            self._asked = True
        except SetpointError as error:
            if error.code == "SP17":  # it has come to hold since its last step, and will say why
                return
            self._held = self._held or str(error)
            self._steering.controller.disable(t, str(error))

    def _judge(self, forces: Array, places: Array, states: list[ControllerState]) -> Outcome:
        rate, wanted = self._steering.rate, self._fault.force
        n = round(_WINDOW * rate)
        size = float(np.linalg.norm(wanted))
        over = forces @ wanted / size - size
        excess, norm = (_lasting(o, n) for o in (over, np.linalg.norm(forces, axis=1) - size))
        last = slice(-round(rate), None)
        along = [i for i in range(3) if wanted[i]]
        error = float(np.sqrt(np.mean((forces[last][:, along] - wanted[along]) ** 2, axis=0).max()))
        served = error < max(_SERVED[0] * float(np.abs(wanted).max()), _SERVED[1])
        final = states[-1]
        told = "; ".join(filter(None, (final.reason, *final.contradictions, final.doubt)))
        starts = round(SETTLE * rate), round(self._again_at * rate), len(forces)
        parts = [slice(a, b) for a, b in pairwise(starts) if b > a]
        travel = max(_free_way(forces[p, i] / wanted[i], places[p, i]) for i in along for p in parts)
        return Outcome(self._fault, excess, norm, float(over.max()), travel, served, told, self._held)


def _lasting(over: Array, n: int) -> float:
    """What is exceeded for longer than n samples in a row, at most."""
    return float(np.lib.stride_tricks.sliding_window_view(over, n + 1).min(axis=1).max())


def _free_way(share: Array, place: Array) -> float:
    """Longest way [m] from where a direction was last in touch, or was asked for; share: of the wanted force."""
    longest, start = 0.0, place[0]
    for s, x in zip(share.tolist(), place.tolist(), strict=True):
        if s >= _TOUCHES:
            start = x
        longest = max(longest, abs(x - start))
    return float(longest)
