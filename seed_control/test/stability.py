# SPDX-License-Identifier: Apache-2.0
"""Margins of the law's loops, quasi-static and in one dimension; docs/control_stability.md derives them.

Surface loop (force). With the share beta of gripper motion that the tip follows, and its frozen estimate beta_hat, the
observer's innovation sees an error of the command only through the difference of the two:

    L(s) = A(s) F(s) e^(-s D) m,    m = 1 - (1 - beta) / (1 - beta_hat)

A: the arm's lag, F: the observer's low-pass, |A|, |F| <= 1, D: any delay. |m| < 1 is enough for stability at every D.

Lean loop (angle-controlled axes). Fed-forward deflection is integral action on the tool's angle with the gain of
tipping G = 1 / (1 - F H / k) in it; the time constant is scaled by the same G, so

    L(s) = 1 / (T s) A(s) e^(-s D).
"""

from math import atan, pi, sqrt


def surface_small_gain(share: float, believed_share: float) -> float:
    """|m| of the surface loop; below one it is stable at any delay. share: beta, believed_share: beta_hat, 0 to 1."""
    return abs(1.0 - (1.0 - share) / (1.0 - believed_share))


def environment_share(stiffness: float, environment_stiffness: float) -> float:
    """beta = k / (k + k_env), both [N/m]."""
    return stiffness / (stiffness + environment_stiffness)


def lean_crossover(time_constant: float, lag: float) -> float:
    """Frequency [rad/s] at which the lean loop's gain is one: w T sqrt(1 + (w lag)^2) = 1."""
    a = (lag / time_constant) ** 2
    if a < 1e-12:
        return 1.0 / time_constant
    return sqrt((sqrt(1.0 + 4.0 * a) - 1.0) / (2.0 * a)) / time_constant


def lean_phase_margin(time_constant: float, delay: float, lag: float, tipping_mismatch: float = 1.0) -> float:
    """Phase margin of the lean loop [rad].

    Args:
        time_constant: T = angle_feedforward [s].
        delay: image age, half a frame and dead time of the arm together [s].
        lag: of the arm and the command's smoothing together [s].
        tipping_mismatch: real tipping gain over the one that the law computed.
    """
    T = time_constant / tipping_mismatch
    w = lean_crossover(T, lag)
    return 0.5 * pi - w * delay - atan(w * lag)


def lean_delay_limit(time_constant: float, lag: float) -> float:
    """Delay [s] at which the lean loop would start to swing."""
    w = lean_crossover(time_constant, lag)
    return (0.5 * pi - atan(w * lag)) / w
