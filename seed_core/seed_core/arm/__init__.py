# SPDX-License-Identifier: Apache-2.0
"""The contract of an arm (docs/arm_contract.md): its limits, the checks of its targets, and its latched hold."""
