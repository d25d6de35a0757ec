# SPDX-License-Identifier: Apache-2.0
"""The map from the membranes' motion to the wrench: its terms, its fit, what the data show."""
