# SPDX-License-Identifier: Apache-2.0
"""What the membranes of a grasp do."""
