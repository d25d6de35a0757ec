# SPDX-License-Identifier: Apache-2.0
"""The nodes `sim`, `bubbles` and `identification_cell`."""
