# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The same tracks through other estimators."""
