# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Arrays of a file, whole or as a stream, and no code that runs on reading."""
