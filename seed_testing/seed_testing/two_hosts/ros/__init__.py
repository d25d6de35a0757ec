# SPDX-License-Identifier: Apache-2.0
"""What runs on each of the two computers."""
