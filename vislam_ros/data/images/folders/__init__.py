# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Folders and files of images, a format a file."""
