# SPDX-License-Identifier: Apache-2.0
"""Another renderer of bubbles, for validation: it shares no line with the simulator's, nor any of its assumptions."""
