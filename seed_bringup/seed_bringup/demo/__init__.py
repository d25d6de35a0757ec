# SPDX-License-Identifier: Apache-2.0
"""The parts of ./seed demo: the plan, the live run, its series and score, the figures, the report."""
