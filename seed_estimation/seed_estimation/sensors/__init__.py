# SPDX-License-Identifier: Apache-2.0
"""The seam for other sensors: what the estimator is to the rest of the suite, and what a sensor is to the estimator."""
