# SPDX-License-Identifier: Apache-2.0
"""Well-typed nonsense for every topic, service, action, parameter and file: what must be refused, and never crash."""
