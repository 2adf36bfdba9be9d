# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The folder of simulated images is an EuRoC/ASL one, whole and the same for the same seed."""

import cv2
import numpy as np
import pytest
import yaml

from vislam_ros.core.geometry import se3
from vislam_ros.data.datasets import npz
from vislam_ros.data.simulation.images import folder as folders
from vislam_ros.data.simulation.images.folder import write_image_folder
from vislam_ros.data.simulation.images.simulated import simulate_images
from vislam_ros.data.trajectory import read_tum
from vislam_ros.errors import VislamError

FILES = {
    "mav0/body.yaml",
    "mav0/cam0/data.csv",
    "mav0/cam0/sensor.yaml",
    "mav0/cam1/data.csv",
    "mav0/cam1/sensor.yaml",
    "mav0/imu0/data.csv",
    "mav0/imu0/sensor.yaml",
    "mav0/state_groundtruth_estimate0/data.csv",
    "mav0/state_groundtruth_estimate0/sensor.yaml",
    "motion.npz",
    "truth.tum",
}


def simulated(**values):
    return simulate_images(scene="room", scale=0.2, seconds=0.4, rate=10.0, **values)


@pytest.fixture(scope="module")
def images():
    return simulated()


@pytest.fixture(scope="module")
def folder(images, tmp_path_factory):
    path = tmp_path_factory.mktemp("images") / "hall"
    told = []
    write_image_folder(path, images, progress=told.append)
    assert told == [1, 2, 3, 4, 5]
    return path


def contents(path):
    return {
        str(file.relative_to(path)): file.read_bytes()
        for file in path.rglob("*")
        if file.is_file()
    }


def read_yaml(path):
    """EuRoC's files begin with a directive that is no YAML."""
    first, _, rest = path.read_text().partition("\n")
    assert first == "%YAML:1.0"
    return yaml.safe_load(rest)


def table(path):
    return np.loadtxt(path, delimiter=",", ndmin=2)


def test_all_is_there_that_belongs_to_it_and_nothing_else(folder, images):
    pictures = {f"mav0/cam{c}/data/{stamp}.png" for c in (0, 1) for stamp in images.stamps}
    assert set(contents(folder)) == FILES | pictures
    assert [path.name for path in folder.parent.iterdir()] == ["hall"]


def test_equal_seeds_write_equal_files(folder, tmp_path):
    write_image_folder(tmp_path / "again", simulated())
    assert contents(tmp_path / "again") == contents(folder)


def test_images_are_those_that_were_drawn_and_listed(folder, images):
    for c in (0, 1):
        camera = folder / f"mav0/cam{c}"
        header, *lines = (camera / "data.csv").read_text().splitlines()
        assert header == "#timestamp [ns],filename"
        assert lines == [f"{stamp},{stamp}.png" for stamp in images.stamps]
        for k, line in enumerate(lines):
            name = line.split(",")[1]
            read = cv2.imread(str(camera / "data" / name), cv2.IMREAD_UNCHANGED)
            assert np.array_equal(read, images.frame(k)[c])


def test_cameras_are_told_as_they_are(folder, images):
    rig = images.rig
    poses = (rig.T_body_left, rig.T_body_left @ rig.T_left_right)
    for c, (camera, T_body_camera) in enumerate(zip((rig.left, rig.right), poses, strict=True)):
        told = read_yaml(folder / f"mav0/cam{c}/sensor.yaml")
        assert told["resolution"] == [150, 96]
        assert told["rate_hz"] == 10
        assert told["camera_model"] == "pinhole"
        assert told["distortion_model"] == "radial-tangential"
        assert told["intrinsics"] == [camera.K[i] for i in ((0, 0), (1, 1), (0, 2), (1, 2))]
        assert told["distortion_coefficients"] == camera.D.tolist()
        assert np.array_equal(np.reshape(told["T_BS"]["data"], (4, 4)), T_body_camera)


def test_cameras_without_lenses_have_no_distortion(tmp_path):
    write_image_folder(tmp_path / "plain", simulated(rectified=True))
    told = [read_yaml(tmp_path / f"plain/mav0/cam{c}/sensor.yaml") for c in (0, 1)]
    assert told[0]["distortion_coefficients"] == [0.0] * 4
    assert told[0]["intrinsics"] == told[1]["intrinsics"]
    left, right = (np.reshape(each["T_BS"]["data"], (4, 4)) for each in told)
    T_left_right = se3.inverse(left) @ right
    assert T_left_right[:3, :3] == pytest.approx(np.eye(3), abs=1e-12)
    assert T_left_right[:3, 3] == pytest.approx([0.11, 0, 0], abs=1e-12)


def test_imu_and_truth_are_written_to_the_last_bit(folder, images):
    imu, mav = images.imu, folder / "mav0"
    samples = table(mav / "imu0/data.csv")
    assert np.array_equal(samples[:, 1:4], imu.angular_velocities)
    assert np.array_equal(samples[:, 4:], imu.accelerations)
    header, *lines = (mav / "imu0/data.csv").read_text().splitlines()
    assert [int(line.split(",")[0]) for line in lines] == imu.stamps.tolist()
    assert header.count(",") == 6
    assert read_yaml(mav / "imu0/sensor.yaml")["rate_hz"] == 200

    truth = table(mav / "state_groundtruth_estimate0/data.csv")
    assert truth.shape == (len(imu.stamps), 17)
    w, x, y, z = truth[:, 4:8].T
    T = se3.pose_matrix(truth[:, 1:4], np.column_stack([x, y, z, w]))
    assert pytest.approx(imu.T_world_body, abs=1e-12) == T
    assert np.array_equal(truth[:, 8:11], imu.velocities)
    assert np.all(truth[:, 11:] == [0.002, 0.002, 0.002, 0, 0, 0])


def test_the_truth_beside_them_is_that_of_the_frames(folder, images):
    truth = read_tum(folder / "truth.tum")
    assert np.array_equal(truth.stamps, images.stamps)
    assert truth.T_world_body == pytest.approx(images.trajectory.T_world_body, abs=1e-12)


def test_the_motion_beside_them_is_a_dataset_without_features(folder, images):
    drive = npz.read(folder / "motion.npz")
    assert len(drive.ids) == 0
    assert drive.twists == pytest.approx(images.twists)
    assert np.abs(drive.twist_stamps - images.stamps).max() < 1000
    assert pytest.approx(images.rig.T_body_left) == drive.camera.T_body_camera


def test_what_is_there_is_kept_without_force_and_what_is_no_such_folder_even_with_it(
    folder, images, tmp_path
):
    with pytest.raises(VislamError, match="hall: exists already"):
        write_image_folder(folder, images)
    other = tmp_path / "papers"
    other.mkdir()
    (other / "thesis.txt").write_text("mine")
    with pytest.raises(VislamError, match="papers: is not of the kind"):
        write_image_folder(other, images, force=True)
    assert (other / "thesis.txt").read_text() == "mine"


def test_a_folder_is_replaced_whole(images, tmp_path):
    path = tmp_path / "hall"
    (path / "mav0").mkdir(parents=True)
    (path / "mav0/old").write_text("")
    write_image_folder(path, images, force=True)
    assert not (path / "mav0/old").exists()
    assert (path / "truth.tum").exists()


def test_nothing_is_left_of_a_folder_that_could_not_be_finished(images, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(folders, "write_tum", full)
    with pytest.raises(VislamError, match=r"hall: cannot write it: No space left"):
        write_image_folder(tmp_path / "hall", images)
    assert list(tmp_path.iterdir()) == []


def test_images_that_cannot_be_packed_are_a_line(images, tmp_path, monkeypatch):
    monkeypatch.setattr(folders.cv2, "imencode", lambda *_: (False, None))
    with pytest.raises(VislamError, match="OpenCV cannot write PNG"):
        write_image_folder(tmp_path / "hall", images)
    assert list(tmp_path.iterdir()) == []
