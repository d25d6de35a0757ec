# SPDX-License-Identifier: Apache-2.0
"""Identification of the stiffness of a compliant grasp."""
