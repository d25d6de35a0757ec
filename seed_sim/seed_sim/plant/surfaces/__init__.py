# SPDX-License-Identifier: Apache-2.0
"""Tables that are not flat: their shape as exact distances, how a seed draws them, and how Drake touches them."""
