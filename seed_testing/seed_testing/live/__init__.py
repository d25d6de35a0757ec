# SPDX-License-Identifier: Apache-2.0
"""Instruments on a live cell: what each node's end does to the rest, and hours of tasks."""
