# SPDX-License-Identifier: Apache-2.0
"""The motion of the membrane's material around and under the tool, as it deforms."""
