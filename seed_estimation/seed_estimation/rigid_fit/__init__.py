# SPDX-License-Identifier: Apache-2.0
"""The estimator `rigid_fit`: one rigid motion to all images, micro-slip, sliding, and an honest covariance."""
