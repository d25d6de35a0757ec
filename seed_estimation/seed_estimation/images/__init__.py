# SPDX-License-Identifier: Apache-2.0
"""Tactile images, their cameras, and what is wrong with either."""
