# SPDX-License-Identifier: Apache-2.0
"""Launch files, configuration, the launcher, bag tools, the demo and its report."""
