# SPDX-License-Identifier: Apache-2.0
"""Pictures of the cell, for the report of a run and for the documents."""
