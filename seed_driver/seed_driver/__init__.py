# SPDX-License-Identifier: Apache-2.0
"""Driver for Universal Robots arms: servoing at 500 Hz with limits and link supervision."""
