# SPDX-License-Identifier: Apache-2.0
"""What the controller knows of arm and tool: kinematics by time, the newest estimate, and whether they are fresh."""

from math import inf, isfinite

import numpy as np

from seed_control.parameters import ControllerParameters
from seed_control.state import EventLog
from seed_control.wrench.history import EXTRAPOLATION, PoseHistory
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, check_pose

REACH = 10.0  # [m] no arm reaches so far
SHIFT = 0.5  # [m] no grasp gives way so far
_JUMP = 0.005  # [s] back between two steps, from which a clock was set back
MOST_BAD = 3  # invalid estimates in a row that make it hold: a single bad frame is bridged, as a lost one is


def _check_near(X: Array, most: float, name: str) -> None:
    """Raises SeedError when a pose (4, 4) is further than `most` [m] from its frame."""
    distance = float(np.abs(X[:3, 3]).max())
    if distance > most:
        raise SeedError(f"{name} is {distance:.4g} m from its frame (at most {most:g} m): is it in metres?")


class Inputs:
    """Takes in kinematics and estimates, each with its stamp, and matches the two.

    Attributes:
        estimate: the newest good one. bad_in_a_row: how many since, and since `count_from`, were invalid; why_bad: why
            the last one was, '' after a good one; why_no_pose: the same of the
            last flange pose, to be added to a sentence.
        arrived: when the newest match was made, and image_stamp: the stamp of its image [s].
    """

    def __init__(self, parameters: ControllerParameters, synchronised: bool, events: EventLog) -> None:
        """synchronised: match an image with the kinematics of its own moment, not with the newest."""
        self._parameters, self._synchronised, self._events = parameters, synchronised, events
        self.history = PoseHistory()
        self.estimate: RelativePoseEstimate | None = None
        self.pending: RelativePoseEstimate | None = None  # not matched yet
        self.bad_in_a_row, self.why_bad, self.why_no_pose = 0, "", ""
        self._counted_from = -inf  # [s]
        self.arrived = self.image_stamp = -inf

    def add_kinematics(self, stamp: float, X_WE: Array) -> bool:
        """Flange pose X_WE (4, 4) at stamp [s]. False (counted) when it is no pose or its stamp does not rise."""
        why = "its stamp does not rise"
        try:
            _check_near(check_pose(X_WE, "X_WE"), REACH, "current_pose")
            good = isfinite(stamp) and self.history.add(stamp, X_WE)
        except SeedError as error:
            why, good = str(error), False
        self.why_no_pose = "" if good else f"; the last one was not used: {why}"
        if good:
            self._events.used("kinematics")
        else:
            self._events.count("kinematics_refused", f"current_pose is not used: {why}")
        return good

    def refused(self, kind: str, why: str) -> None:
        """An input was refused before it came here: one of 'kinematics', 'estimates' and 'setpoints'."""
        self._events.say(kind, why)
        if kind == "kinematics":
            self.why_no_pose = f"; the last one was not used: {why}"
        if kind == "estimates":
            self.why_bad = why

    def add_estimate(self, estimate: RelativePoseEstimate, unobserved: str) -> bool:
        """A new relative pose. False (counted) when it is invalid, older than the last one, or no pose.

        unobserved: what is controlled that it does not observe, which makes it invalid; '' for nothing.
        """
        last = self.estimate.stamp if self.estimate is not None else -inf
        if isfinite(estimate.stamp) and estimate.stamp <= last:
            self._events.count("estimates_out_of_order")
            return False
        why = _why_unusable(estimate) or unobserved
        if why:
            self._events.count("estimates_invalid", why)
            self.why_bad = why
            if not -inf < estimate.stamp <= self._counted_from:
                self.bad_in_a_row += 1
            return False
        missed, self.estimate, self.pending = self.pending, estimate, estimate
        self.bad_in_a_row, self.why_bad = 0, ""
        if missed is not None and missed.stamp - self.history.newest_stamp > EXTRAPOLATION:
            self._dated_ahead(missed.stamp - self.history.newest_stamp)
        return True

    def _dated_ahead(self, by: float) -> None:
        """An estimate has waited in vain for kinematics of its moment, by [s] after the newest that have come."""
        if isfinite(by):
            self.why_bad = f"it is dated {by:.3f} s after the newest current_pose: compare the clocks"
            self._events.count("estimates_unmatched", f"estimate meets no kinematics of its moment: {self.why_bad}")

    @property
    def heard(self) -> bool:
        """Whether poses of the flange and estimates have come at all, usable or not."""
        return self.history.newest_stamp > -inf and (self.arrived > -inf or bool(self.why_bad))

    def count_from(self, t: float) -> None:
        """Count invalid estimates anew. Those of images up to t [s] that are still to be read are passed over."""
        self.bad_in_a_row, self.why_bad, self._counted_from = 0, "", t

    def match(self, t: float) -> tuple[RelativePoseEstimate, Array] | None:
        """The newest estimate with X_WE (4, 4) of its moment, once; it waits while kinematics are still to come."""
        estimate = self.pending
        if estimate is None:
            return None
        stamp, history = estimate.stamp, self.history
        newest = history.newest() if len(history) else None
        X_WE = history.at(stamp) if self._synchronised else newest
        if X_WE is not None:
            self.pending, self.arrived, self.image_stamp = None, t, stamp
            self._events.used("estimates")
            return estimate, X_WE
        if stamp < history.oldest_stamp or t - stamp > self._parameters.max_estimate_age:
            self.pending = None
            why = f"estimate of {t - stamp:.3f} s ago meets no kinematics of its moment"
            self._events.count("estimates_unmatched", why)
        return None

    def set_back(self, t: float, before: float) -> str:
        """Why everything was forgotten at time t [s], '' if it was not: what has come is of a time still to come.

        Its stamps would pass for fresh until then, and nothing that comes now for newer. before: of the last step [s].
        """
        newest = max(self.history.newest_stamp, self.estimate.stamp if self.estimate is not None else -inf)
        most = max(self._parameters.kinematics_timeout, self._parameters.max_estimate_age)
        if newest - t <= most:
            newest, most = before, _JUMP
        if newest - t <= most:
            return ""
        self.history, self.estimate, self.pending = PoseHistory(), None, None
        self.arrived = self.image_stamp = self._counted_from = -inf
        return (
            f"the clock was set back by {newest - t:.3f} s (at most {most:g} s): what was measured before is forgotten"
        )

    def staleness(self, t: float) -> str:
        """Why the inputs must not be used any more; empty while they may."""
        p, newest = self._parameters, self.history.newest_stamp
        last = f"; the last one was not used: {self.why_bad}" if self.why_bad else ""
        if t - newest > p.kinematics_timeout:
            none = f"current_pose is stale: {t - newest:.3f} s old" if newest > -inf else "no current_pose has come yet"
            return f"{none}, at most {p.kinematics_timeout:g} s{self.why_no_pose}"
        if self.arrived == -inf:
            return f"no estimate of the relative pose has come yet{last}"
        if t - self.arrived > p.estimate_timeout:
            return f"relative_pose is stale: none for {t - self.arrived:.3f} s, at most {p.estimate_timeout:g} s{last}"
        if t - self.image_stamp > p.max_estimate_age:
            return f"relative_pose is stale: {t - self.image_stamp:.3f} s old, at most {p.max_estimate_age:g} s{last}"
        return ""


def _why_unusable(estimate: RelativePoseEstimate) -> str:
    if not isfinite(estimate.stamp):
        return "estimate's stamp is not finite"
    if estimate.gross_slip:
        return "estimate is invalid: the tool has slid in the grasp"
    if not estimate.valid:
        return f"estimate is invalid: {estimate.reason or 'no reason given'}"
    try:
        _check_near(check_pose(estimate.X_CT, "X_CT"), SHIFT, "relative_pose")
    except SeedError as error:
        return str(error)
    stated = estimate.covariance.diagonal()
    if not (stated >= 0.0).all():  # of nan, too
        return f"estimate is invalid: a variance of its covariance is {stated.min():.3g}, not at least 0"
    return ""
