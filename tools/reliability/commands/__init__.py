# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What ``tools/faults.py`` can be told, a module for each."""
