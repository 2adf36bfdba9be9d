# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Updates of a Gaussian, and the gates before them."""
