# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A small drive in images, written in every format there is.

A camera looks along the body's x axis at a wall and moves to its right, two pixels a frame.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.data.trajectory import NANOSECONDS

Image = NDArray[np.uint8]
Array = NDArray[np.float64]

FRAMES = 8
SIZE = WIDTH, HEIGHT = 160, 120
START, PERIOD = 1_400_000_000_000_000_000, 100_000_000
STAMPS = START + PERIOD * np.arange(FRAMES)
FOCAL, BASELINE, DISPARITY, SHIFT = 100.0, 0.1, 5, 2
K = np.array([[FOCAL, 0.0, 79.5], [0.0, FOCAL, 59.5], [0.0, 0.0, 1.0]])
# Optical axes (right, down, forward) in body axes (forward, left, up).
T_BODY_LEFT = np.array(
    [
        [0.0, 0.0, 1.0, 0.2],
        [-1.0, 0.0, 0.0, 0.05],
        [0.0, -1.0, 0.0, 0.1],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
T_LEFT_RIGHT = np.array(
    [[1.0, 0.0, 0.0, BASELINE], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
CAMERA = StereoCamera.from_matrices(K, BASELINE, T_BODY_LEFT)
#: To the right, which is against the body's y axis.
SPEED = SHIFT * BASELINE / DISPARITY * NANOSECONDS / PERIOD


def wall() -> Image:
    """What the cameras see, wider than their images."""
    rng = np.random.default_rng(4)
    dots = rng.integers(0, 256, (HEIGHT, WIDTH + SHIFT * FRAMES + DISPARITY), dtype=np.uint8)
    smooth = cv2.GaussianBlur(dots, (0, 0), 1.5)
    return np.asarray(
        cv2.normalize(smooth, np.empty_like(smooth), 0, 255, cv2.NORM_MINMAX), dtype=np.uint8
    )


def pair(k: int) -> tuple[Image, Image]:
    """Left and right image of frame ``k``."""
    first = SHIFT * k
    seen = wall()
    return (
        np.ascontiguousarray(seen[:, first : first + WIDTH]),
        np.ascontiguousarray(seen[:, first + DISPARITY : first + DISPARITY + WIDTH]),
    )


def write_image(path: Path, image: Image) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def matrix_text(T: Array) -> str:
    return f"{{rows: 4, cols: 4, data: {T.ravel().tolist()}}}"


def sensor_yaml(T_body_camera: Array) -> str:
    return (
        "%YAML:1.0\n"
        f"T_BS: {matrix_text(T_body_camera)}\n"
        f"resolution: [{WIDTH}, {HEIGHT}]\n"
        f"camera_model: pinhole\nintrinsics: [{FOCAL}, {FOCAL}, {K[0, 2]}, {K[1, 2]}]\n"
        "distortion_model: radial-tangential\n"
        "distortion_coefficients: [0.0, 0.0, 0.0, 0.0]\n"
    )


def write_asl(folder: Path) -> Path:
    """EuRoC's layout, with an IMU of 200 Hz and a reference."""
    root = folder / "mav0"
    for name, side, T in (
        ("cam0", 0, T_BODY_LEFT),
        ("cam1", 1, T_BODY_LEFT @ T_LEFT_RIGHT),
    ):
        for k, stamp in enumerate(STAMPS):
            write_image(root / name / "data" / f"{stamp}.png", pair(k)[side])
        (root / name / "sensor.yaml").write_text(sensor_yaml(T))
        rows = "".join(f"{stamp},{stamp}.png\n" for stamp in STAMPS)
        (root / name / "data.csv").write_text(f"#timestamp [ns],filename\n{rows}")
    imu = root / "imu0"
    imu.mkdir()
    (imu / "sensor.yaml").write_text(f"%YAML:1.0\nT_BS: {matrix_text(np.eye(4))}\n")
    times = np.arange(STAMPS[0] - PERIOD, STAMPS[-1] + PERIOD, PERIOD // 20)
    (imu / "data.csv").write_text(
        "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n"
        + "".join(f"{time},0.001,-0.002,0.003,0.0,0.0,9.81\n" for time in times)
    )
    reference = root / "state_groundtruth_estimate0"
    reference.mkdir()
    (reference / "data.csv").write_text(
        "#timestamp,p_x,p_y,p_z,q_w,q_x,q_y,q_z\n"
        + "".join(
            f"{stamp},5.0,{7.0 - SPEED * 1e-9 * (stamp - STAMPS[0])},1.0,1.0,0.0,0.0,0.0\n"
            for stamp in STAMPS
        )
    )
    return folder


def projection_text(shift: float) -> str:
    P = np.column_stack([K, [shift, 0.0, 0.0]])
    return " ".join(repr(float(value)) for value in P.ravel())


def write_kitti_odometry(folder: Path, *, times: bool = True) -> Path:
    """The layout of KITTI's odometry benchmark, with poses beside the sequences."""
    for name, side in (("image_0", 0), ("image_1", 1)):
        for k in range(FRAMES):
            write_image(folder / name / f"{k:06d}.png", pair(k)[side])
    (folder / "calib.txt").write_text(
        f"P0: {projection_text(0.0)}\nP1: {projection_text(-FOCAL * BASELINE)}\n"
    )
    if times:
        seconds = (STAMPS - START) / NANOSECONDS
        (folder / "times.txt").write_text("".join(f"{second:.6e}\n" for second in seconds))
    poses = folder.parent / "poses"
    poses.mkdir(exist_ok=True)
    step = SPEED * PERIOD / NANOSECONDS
    rows = (f"1 0 0 {k * step!r} 0 1 0 0 0 0 1 0\n" for k in range(FRAMES))
    (poses / f"{folder.name}.txt").write_text("".join(rows))
    return folder


def clock_text(stamp: int) -> str:
    second, nanosecond = divmod(stamp, NANOSECONDS)
    moment = np.datetime64(second, "s")
    return f"{str(moment).replace('T', ' ')}.{nanosecond:09d}"


def write_kitti_raw(folder: Path) -> Path:
    """A drive of KITTI's raw recordings, its calibrations in the folder around it.

    The car stands on a slope of 0.1 rad, heading north, and rolls to its right.
    """
    for name, side in (("image_00", 0), ("image_01", 1)):
        for k in range(FRAMES):
            write_image(folder / name / "data" / f"{k:010d}.png", pair(k)[side])
        (folder / name / "timestamps.txt").write_text(
            "".join(f"{clock_text(stamp)}\n" for stamp in STAMPS.tolist())
        )
    data = folder / "oxts" / "data"
    data.mkdir(parents=True)
    for k in range(FRAMES):
        values = np.zeros(30)
        values[:6] = 49.0, 8.4 + 1e-6 * k, 100.0, 0.0, -0.1, np.pi / 2
        values[8:11] = 10.0, -SPEED, 1.0
        values[17:20] = 0.001, -0.002, 0.003
        (data / f"{k:010d}.txt").write_text(" ".join(map(repr, values.tolist())))
    (folder / "oxts" / "timestamps.txt").write_text(
        "".join(f"{clock_text(stamp + 3_000_000)}\n" for stamp in STAMPS.tolist())
    )
    around = folder.parent
    rows = {f"S_rect_{n}": f"{WIDTH} {HEIGHT}" for n in ("00", "01")}
    rows |= {f"S_{n}": f"{WIDTH + 20} {HEIGHT + 10}" for n in ("00", "01")}
    rows |= {"R_rect_00": "1 0 0 0 1 0 0 0 1"}
    rows |= {"P_rect_00": projection_text(0.0)}
    rows |= {"P_rect_01": projection_text(-FOCAL * BASELINE)}
    write_lines(around / "calib_cam_to_cam.txt", {"calib_time": "09-Jan-2012 13:57:47", **rows})
    T_left_body = np.linalg.inv(T_BODY_LEFT)
    write_lines(
        around / "calib_velo_to_cam.txt",
        {
            "R": " ".join(map(repr, T_left_body[:3, :3].ravel().tolist())),
            "T": " ".join(map(repr, T_left_body[:3, 3].tolist())),
        },
    )
    write_lines(around / "calib_imu_to_velo.txt", {"R": "1 0 0 0 1 0 0 0 1", "T": "0 0 0"})
    return folder


def write_lines(path: Path, rows: dict[str, str]) -> None:
    path.write_text("".join(f"{name}: {text}\n" for name, text in rows.items()))


def course_images() -> dict[str, list[Image]]:
    pairs = [pair(k) for k in range(FRAMES)]
    return {"cam_imgs_L": [left for left, _ in pairs], "cam_imgs_R": [right for _, right in pairs]}


def dataset() -> dict[str, Array]:
    """The same drive as a dataset with a few tracks that lie on the wall."""
    features = np.full((4, 30, FRAMES), -1.0)
    rng = np.random.default_rng(5)
    places = rng.uniform([40.0, 10.0], [WIDTH - 10.0, HEIGHT - 10.0], (30, 2))
    for k in range(FRAMES):
        u, v = places[:, 0] - SHIFT * k, places[:, 1]
        features[:, :, k] = u, v, u - DISPARITY, v
    return {
        "features": features,
        "time_stamps": (STAMPS / NANOSECONDS)[None],
        "linear_velocity": np.tile([[0.0], [-SPEED], [0.0]], FRAMES),
        "angular_velocity": np.zeros((3, FRAMES)),
        "K": K,
        "b": np.array(BASELINE),
        "imu_T_cam": T_BODY_LEFT,
    }


def write_dataset(path: Path) -> Path:
    arrays: Any = dataset()
    np.savez(path, **arrays)
    return path


def write_course(folder: Path) -> Path:
    """Images of the course, and their dataset beside them."""
    folder.mkdir(exist_ok=True)
    write_dataset(folder / "dataset00.npz")
    images: Any = course_images()
    np.save(folder / "dataset00_imgs.npy", images, allow_pickle=True)
    return folder / "dataset00_imgs.npy"
