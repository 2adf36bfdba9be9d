# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Many kinds of drives, dense and sparse, clean and wrong: what each change is decided by."""
