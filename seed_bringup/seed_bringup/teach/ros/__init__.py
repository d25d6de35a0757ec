# SPDX-License-Identifier: Apache-2.0
"""Teaching on a running cell."""
