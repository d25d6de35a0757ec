# SPDX-License-Identifier: Apache-2.0
"""The samples of an identification, and the files and bags that hold them."""
