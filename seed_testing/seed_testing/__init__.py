# SPDX-License-Identifier: Apache-2.0
"""Instruments that prove the suite: benchmarks, fault bench, arm contract, validation, recordings; users run none."""
