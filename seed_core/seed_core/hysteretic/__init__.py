# SPDX-License-Identifier: Apache-2.0
"""A grasp that stiffens and has friction: the model of its wrench, and the file of its identification."""
