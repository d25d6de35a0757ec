# SPDX-License-Identifier: Apache-2.0
"""`./seed compare`: this suite and what people use instead, in the same plant, tasks, delays and noise."""
