# SPDX-License-Identifier: Apache-2.0
"""Checks of what the controller believes while it runs: each has `update(...)` and `reason`, '' while all is well."""
