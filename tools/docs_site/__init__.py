# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The documentation as a site that needs no network: ``make docs``."""
