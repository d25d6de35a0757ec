# SPDX-License-Identifier: Apache-2.0
"""Hidden worlds: cells that differ from what estimator and controller believe, and the score over draws of them."""
