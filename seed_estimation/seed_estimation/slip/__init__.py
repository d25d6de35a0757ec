# SPDX-License-Identifier: Apache-2.0
"""Incipient and gross slip: the signs by which a tool that breaks loose is told."""
