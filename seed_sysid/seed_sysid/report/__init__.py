# SPDX-License-Identifier: Apache-2.0
"""What an identification leaves: figures, summary, files, report."""
