# SPDX-License-Identifier: Apache-2.0
"""Hybrid force and pose control through a compliant grasp (Algorithm 2 of SEED)."""
