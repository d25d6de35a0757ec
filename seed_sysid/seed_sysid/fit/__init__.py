# SPDX-License-Identifier: Apache-2.0
"""From samples to stiffness: the load model, the fit, its checks, and what else is fitted."""
