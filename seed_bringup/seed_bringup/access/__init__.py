# SPDX-License-Identifier: Apache-2.0
"""SROS 2 for a cell: what each node may do, and the keys and signed permissions that the middleware reads."""
