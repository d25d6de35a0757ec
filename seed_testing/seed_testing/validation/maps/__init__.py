# SPDX-License-Identifier: Apache-2.0
"""Which function of what the membranes do gives the wrench: models compared on random membranes."""
