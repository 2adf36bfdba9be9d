# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The mathematics of the filter: numpy and LAPACK, no ROS, no files.

Conventions, stated once and used throughout:

- ``T_world_body`` maps body coordinates to world coordinates. A pose error is on the right:
  ``T = T_hat Exp(xi)`` with ``xi = [rho; theta]``, translation first.
- Body axes are x forward, y left, z up (REP-103); camera axes are x right, y down, z forward.
- Quaternions are ``x, y, z, w``. Times are integer nanoseconds, lengths metres, angles radians.
- A landmark of the world-frame filters is its position in the world, with an additive error.
"""
