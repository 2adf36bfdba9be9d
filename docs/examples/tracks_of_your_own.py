# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Feed the tracks of a tracker of your own, without any file.

Here a toy stands for your sensors: a car that drives a circle through a cloud of points and sees
them without noise. Put your tracker and your IMU in its place.
"""

import numpy as np

import vislam_ros as vi
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera

# The rectified pair: its intrinsics, the distance between the two cameras, and the pose of the
# left one in the body. Body axes are x forward, y left, z up; camera axes x right, y down, z
# forward.
K = np.array([[700.0, 0.0, 600.0], [0.0, 700.0, 180.0], [0.0, 0.0, 1.0]])
T_body_camera = np.array(
    [[0.0, 0.0, 1.0, 1.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.5], [0.0, 0.0, 0.0, 1.0]]
)
CAMERA = StereoCamera.from_matrices(K, baseline=0.5, T_body_camera=T_body_camera)

PERIOD = 0.1  # seconds from frame to frame
TWIST = np.array(
    [10.0, 0.0, 0.0, 0.0, 0.0, 0.2]
)  # [v; omega]: 10 m/s ahead, 0.2 rad/s to the left


def see(points_world: np.ndarray, T_world_body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ids (n,) and pixels (n, 4) of what lies in view; this is where your tracker goes."""
    T_camera_world = se3.inverse(T_world_body @ T_body_camera)
    points = points_world @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]
    (ahead,) = np.nonzero(points[:, 2] > 2.0)
    u_left, u_right, v = CAMERA.project(points[ahead]).T
    in_view = (u_left < 1200) & (u_right > 0) & (v > 0) & (v < 360)
    return ahead[in_view], np.column_stack([u_left, v, u_right, v])[in_view]


def main() -> None:
    """Drive the circle, hand over what was seen, and see how far the estimate is off."""
    rng = np.random.default_rng(0)
    points_world = rng.uniform([-20, -20, 0], [120, 120, 10], (500, 3))
    T_world_body = np.eye(4)
    stamps, ids, pixels, truth = [], [], [], []
    for k in range(100):
        if k:
            T_world_body = T_world_body @ se3.exp(PERIOD * TWIST)
        frame_ids, frame_pixels = see(points_world, T_world_body)
        stamps.append(1000.0 + k * PERIOD)  # floats are seconds; whole numbers are nanoseconds
        ids.append(frame_ids)
        pixels.append(frame_pixels + rng.normal(0.0, 0.5, frame_pixels.shape))
        truth.append(T_world_body[:3, 3])
    # The twist of a stamp is that of the time which ends there. An IMU is never this good:
    twists = TWIST + rng.normal(0.0, [0.3, 0.3, 0.3, 0.02, 0.02, 0.02], (100, 6))

    drive = vi.Drive.from_tracks(stamps, ids, pixels, twists, CAMERA)
    solution = vi.solve(drive)

    for name, path in (
        ("dead reckoning", solution.dead_reckoning),
        ("estimate", solution.trajectory),
    ):
        error = np.linalg.norm(path.positions[-1] - truth[-1])
        print(f"{name}: off by {error:.2f} m after {PERIOD * 99 * TWIST[0]:.0f} m")


if __name__ == "__main__":
    main()
