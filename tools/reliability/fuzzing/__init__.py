# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Coverage-guided fuzzing of all that is read from files."""
