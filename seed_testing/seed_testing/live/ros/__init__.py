# SPDX-License-Identifier: Apache-2.0
"""A live cell's client."""
