# SPDX-License-Identifier: Apache-2.0
"""The driver against a stand-in controller with which everything goes wrong."""
