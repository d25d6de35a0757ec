# SPDX-License-Identifier: Apache-2.0
"""What the page hears of a running cell or reads from a bag, and what its buttons do."""
