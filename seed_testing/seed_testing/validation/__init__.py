# SPDX-License-Identifier: Apache-2.0
"""Estimators of the relative pose against known motion: trajectories, runs, scores, figures."""
