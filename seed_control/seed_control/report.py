# SPDX-License-Identifier: Apache-2.0
"""What the controller tells of a step: from law, supervisor and counters to a ControllerState."""

from math import inf

from seed_control.law.published import PublishedLaw
from seed_control.setpoint.setpoints import Setpoint
from seed_control.state import ControllerState, EventLog, Mode
from seed_control.supervisor import Supervisor


def describe(
    t: float,
    setpoint: Setpoint | None,
    limits: tuple[str, ...],
    law: PublishedLaw,
    supervisor: Supervisor,
    events: EventLog,
) -> ControllerState:
    """The state after a step.

    Args:
        t: [s] of the step. setpoint: that is followed. limits: names of those that the command met.
        law, supervisor, events: the controller's.
    """
    plan, held, m, hybrid = law.plan, supervisor.guard.held, law.measured, law.setpoint
    mode = _mode(setpoint, law, supervisor)
    return ControllerState(
        stamp=t,
        mode=mode,
        enabled=supervisor.guard.enabled,
        setpoint_kind=setpoint.kind if setpoint is not None else "",
        desired=hybrid.wrench if hybrid is not None else None,
        estimated=law.estimated_task,
        filtered=law.filtered_task,
        model_spring=m.model_spring if m is not None else None,
        deviation=supervisor.uncertainty.deviation,
        covariance=supervisor.uncertainty.covariance,
        contradictions=supervisor.references.contradictions,
        doubt=m.doubt if m is not None else "",
        measured_X_CT=m.X_CT if m is not None else None,
        X_W_tip=law.X_W_tip,
        trailing=law.trailing if hybrid is not None else None,
        R_W_task=plan.R_W_task,
        limits_hit=limits,
        reason=held or events.remark or supervisor.warning,
        in_contact=law.contact.made,
        settled=mode == "contact" and law.settled,
        image_age=t - m.stamp if m is not None else inf,
        counters=events.counters,
    )


def _mode(setpoint: Setpoint | None, law: PublishedLaw, supervisor: Supervisor) -> Mode:
    if not supervisor.guard.enabled:
        return "disabled"
    if supervisor.guard.held:
        return "holding"
    if setpoint is None:
        return "idle"
    if not law.regulates_force:  # nor does a relative pose
        return "position"
    return "contact" if law.contact.made else "approach"
