# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated images as an EuRoC/ASL folder, with the truth and measured twists beside them.

The layout is that of the EuRoC datasets (Burri et al., *The EuRoC micro aerial vehicle datasets*,
IJRR 2016)::

    mav0/body.yaml
    mav0/cam0, mav0/cam1                    data.csv, sensor.yaml, data/STAMP.png
    mav0/imu0                               data.csv, sensor.yaml
    mav0/state_groundtruth_estimate0        data.csv, sensor.yaml
    truth.tum                               true poses of the body at the frames
    motion.npz                              a dataset with a twist for each frame, without features
"""

import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import RawCamera
from vislam_ros.data.files.whole_directory import whole_directory
from vislam_ros.data.simulation.file import write_arrays
from vislam_ros.data.simulation.images.imu import IMU_RATE
from vislam_ros.data.simulation.images.simulated import (
    ACCELEROMETER_NOISE_DENSITY,
    SimulatedImages,
)
from vislam_ros.data.simulation.images.texture import Grey
from vislam_ros.data.trajectory import NANOSECONDS, write_tum
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

TRUTH, MOTION = "truth.tum", "motion.npz"

_IMU_COLUMNS = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)
_TRUTH_COLUMNS = (
    "#timestamp,p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],"
    "v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],"
    "b_w_RS_S_x [rad s^-1],b_w_RS_S_y [rad s^-1],b_w_RS_S_z [rad s^-1],"
    "b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],b_a_RS_S_z [m s^-2]"
)
# Images hardly pack any better for more work, because of their noise.
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1)


def write_image_folder(
    path: Path,
    simulated: SimulatedImages,
    *,
    force: bool = False,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Draw all frames into a folder, which is there whole or not at all.

    Equal images are equal files.

    Parameters
    ----------
    path : Path
    simulated : SimulatedImages
    force : bool
        Replace a folder that holds ``mav0``.
    progress : callable, optional
        Told how many frames are drawn.

    Raises
    ------
    VislamError
        Where the folder exists and is not to be replaced, or cannot be written.
    """
    with whole_directory(path, force=force, replaceable=_is_image_folder) as work:
        mav = work / "mav0"
        rig = simulated.rig
        cameras = (
            (mav / "cam0", rig.left, rig.T_body_left),
            (mav / "cam1", rig.right, rig.T_body_left @ rig.T_left_right),
        )
        for folder, camera, T_body_camera in cameras:
            (folder / "data").mkdir(parents=True)
            text = _camera_yaml(camera, T_body_camera, simulated.settings.rate)
            (folder / "sensor.yaml").write_text(text, encoding="ascii")
            rows = (f"{stamp},{stamp}.png" for stamp in simulated.stamps.tolist())
            _write_csv(folder / "data.csv", "#timestamp [ns],filename", rows)
        for k, (stamp, left, right) in enumerate(simulated.frames(), start=1):
            for image, (folder, _, _) in zip((left, right), cameras, strict=True):
                _write_png(folder / "data" / f"{stamp}.png", image, path)
            if progress is not None:
                progress(k)
        _write_imu(mav / "imu0", simulated)
        _write_truth(mav / "state_groundtruth_estimate0", simulated)
        text = "%YAML:1.0\ncomment: a simulated body, x forward, y to the left, z up\n"
        (mav / "body.yaml").write_text(text, encoding="ascii")
        write_tum(work / TRUTH, simulated.trajectory)
        _write_motion(work / MOTION, simulated)


def _is_image_folder(path: Path) -> bool:
    return (path / "mav0").is_dir()


def _write_png(path: Path, image: Grey, output: Path) -> None:
    packed, content = cv2.imencode(".png", image, _PNG)
    if not packed:
        raise VislamError(f"{output}: OpenCV cannot write PNG files here: install another build")
    path.write_bytes(content.tobytes())


def _write_imu(folder: Path, simulated: SimulatedImages) -> None:
    folder.mkdir()
    imu = simulated.imu
    values = np.column_stack([imu.angular_velocities, imu.accelerations])
    _write_csv(folder / "data.csv", _IMU_COLUMNS, _rows(imu.stamps, values))
    text = (
        "%YAML:1.0\n"
        "sensor_type: imu\n"
        "comment: simulated; a sample is the mean over the time since the one before\n\n"
        f"{_matrix_yaml(np.eye(4))}"
        f"rate_hz: {IMU_RATE}\n\n"
        f"gyroscope_noise_density: {simulated.settings.gyro_noise_density!r}\n"
        "gyroscope_random_walk: 0.0\n"
        f"accelerometer_noise_density: {ACCELEROMETER_NOISE_DENSITY!r}\n"
        "accelerometer_random_walk: 0.0\n"
    )
    (folder / "sensor.yaml").write_text(text, encoding="ascii")


def _write_truth(folder: Path, simulated: SimulatedImages) -> None:
    folder.mkdir()
    imu = simulated.imu
    quaternions = se3.quaternion_from_rotation(imu.T_world_body[:, :3, :3])
    biases = np.tile([*simulated.settings.gyro_bias, 0.0, 0.0, 0.0], (len(imu.stamps), 1))
    values = np.column_stack(
        [imu.T_world_body[:, :3, 3], quaternions[:, [3, 0, 1, 2]], imu.velocities, biases]
    )
    _write_csv(folder / "data.csv", _TRUTH_COLUMNS, _rows(imu.stamps, values))
    text = (
        "%YAML:1.0\n"
        "sensor_type: visual-inertial\n"
        "comment: exact, of a simulation\n\n"
        f"{_matrix_yaml(np.eye(4))}"
    )
    (folder / "sensor.yaml").write_text(text, encoding="ascii")


def _write_motion(path: Path, simulated: SimulatedImages) -> None:
    """Write twists, and the left raw camera as if it were one of a rectified pair."""
    rig, twists = simulated.rig, simulated.twists
    arrays = {
        "features": np.zeros((4, 0, len(twists))),
        "time_stamps": (simulated.stamps / NANOSECONDS)[None],
        "linear_velocity": twists[:, :3].T,
        "angular_velocity": twists[:, 3:].T,
        "K": rig.left.K,
        "b": np.array(np.linalg.norm(rig.T_left_right[:3, 3])),
        "imu_T_cam": rig.T_body_left,
        "ground_truth_T_world_body": simulated.trajectory.T_world_body,
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        write_arrays(archive, arrays)


def _write_csv(path: Path, columns: str, rows: Iterable[str]) -> None:
    text = "".join(f"{row}\n" for row in (columns, *rows))
    path.write_text(text, encoding="ascii")


def _rows(stamps: NDArray[np.int64], values: Array) -> Iterable[str]:
    """Lines with the fewest digits that read back to the same floats."""
    for stamp, row in zip(stamps.tolist(), values.tolist(), strict=True):
        yield f"{stamp},{','.join(map(repr, row))}"


def _camera_yaml(camera: RawCamera, T_body_camera: Array, rate: float) -> str:
    K = camera.K
    distortion = camera.D.tolist() or [0.0, 0.0, 0.0, 0.0]
    return (
        "%YAML:1.0\n"
        "sensor_type: camera\n"
        "comment: simulated\n\n"
        f"{_matrix_yaml(T_body_camera)}"
        f"rate_hz: {rate:g}\n"
        f"resolution: {list(camera.image_size)}\n"
        "camera_model: pinhole\n"
        f"intrinsics: {[float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])]}"
        " # fu, fv, cu, cv\n"
        "distortion_model: radial-tangential\n"
        f"distortion_coefficients: {distortion}\n"
    )


def _matrix_yaml(T: Array) -> str:
    rows = [", ".join(map(repr, row)) for row in T.tolist()]
    indented = (",\n" + 9 * " ").join(rows)
    return f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{indented}]\n"
