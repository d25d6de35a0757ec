# SPDX-License-Identifier: Apache-2.0
"""The suite's own procedures, run in a hidden world: all that estimator and controller may know of it."""
