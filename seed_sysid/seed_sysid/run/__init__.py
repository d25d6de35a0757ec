# SPDX-License-Identifier: Apache-2.0
"""The procedure: which poses are visited, and how, on a live cell or a simulated one."""
