# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of nodes, and the nodes that feed them."""
