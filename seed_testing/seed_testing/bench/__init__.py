# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of speed on this machine: a module each, whose run() returns its figures; ros/ has those of nodes."""
