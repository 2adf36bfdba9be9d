# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether covariances are honest, and what the errors of real tracks are like."""
