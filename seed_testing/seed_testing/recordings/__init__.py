# SPDX-License-Identifier: Apache-2.0
"""Real recordings that are no part of the project: what the suite makes of them."""
