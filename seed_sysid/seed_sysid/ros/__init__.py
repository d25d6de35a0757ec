# SPDX-License-Identifier: Apache-2.0
"""The node `sysid`, and its client."""
