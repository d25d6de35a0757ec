# SPDX-License-Identifier: Apache-2.0
"""The calibration of range and cameras: what is captured, what is fitted to it, and the file."""
