# SPDX-License-Identifier: Apache-2.0
"""The commands of ./seed that launch, play and watch a cell, those of developers, and the dispatcher of all."""
