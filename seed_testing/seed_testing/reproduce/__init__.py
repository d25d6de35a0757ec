# SPDX-License-Identifier: Apache-2.0
"""The experiments of the paper, done again in simulation: one module per figure."""
