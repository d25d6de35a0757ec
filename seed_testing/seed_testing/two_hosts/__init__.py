# SPDX-License-Identifier: Apache-2.0
"""A cell of two computers on this one: two network namespaces, and a network between them that is made bad."""
