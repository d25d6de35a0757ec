# SPDX-License-Identifier: Apache-2.0
"""What ./seed demo shows of a run: the recorded series, the figures, the report."""
