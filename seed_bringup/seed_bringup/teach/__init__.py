# SPDX-License-Identifier: Apache-2.0
"""./seed teach: a task file of what was shown, in a bag or on a running cell."""
