# SPDX-License-Identifier: Apache-2.0
"""A law's score over the whole of a wipe, from its first millimetre, under conditions that differ in one thing each."""
