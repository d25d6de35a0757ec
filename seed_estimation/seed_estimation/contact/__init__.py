# SPDX-License-Identifier: Apache-2.0
"""A bubble at rest, the contact patch against it, and whether a grasp was taken under load."""
