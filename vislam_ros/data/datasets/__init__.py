# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Dataset files, and what is put right in them."""
