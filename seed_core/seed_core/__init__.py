# SPDX-License-Identifier: Apache-2.0
"""Spatial algebra and the six-axis bushing model: numpy and scipy only."""
