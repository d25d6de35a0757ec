# SPDX-License-Identifier: Apache-2.0
"""What a command-line program needs: its options and output, and the files that are installed beside its code."""
