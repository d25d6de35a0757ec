# SPDX-License-Identifier: Apache-2.0
"""Bubbles with mechanics: a pressurised sheet in contact, with friction, that gives force, images and pressure."""
