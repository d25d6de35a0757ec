# SPDX-License-Identifier: Apache-2.0
"""The closed loop with something wrong in it: what the force, the way and the reason come to."""
