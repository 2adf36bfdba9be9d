# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A dataset is read in every spelling, sparsely, and refused with one line where it is wrong."""

import io
import os
import subprocess
import sys
import zipfile
from typing import Any

import numpy as np
import pytest

from vislam_ros.core.geometry import se3
from vislam_ros.data.datasets import npz
from vislam_ros.data.datasets.conventions import Conventions
from vislam_ros.data.trajectory import nanoseconds
from vislam_ros.errors import VislamError

T, M = 5, 4
K = np.array([[700.0, 0.0, 600.0], [0.0, 690.0, 180.0], [0.0, 0.0, 1.0]])
T_BODY_CAMERA = np.array(
    [[0.0, 0.0, 1.0, 1.5], [-1.0, 0.0, 0.0, 0.25], [0.0, -1.0, 0.0, -0.5], [0.0, 0.0, 0.0, 1.0]]
)
T_CAMERA_BODY = se3.inverse(T_BODY_CAMERA)
T_LEFT_RIGHT = se3.pose_matrix([0.5, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])


def dataset() -> dict[str, Any]:
    """A tiny valid dataset in the current spelling."""
    rng = np.random.default_rng(7)
    features = np.full((4, M, T), -1.0)
    seen = rng.random((M, T)) < 0.6
    features[:, seen] = rng.integers(0, 1200, (4, seen.sum())) / 4
    return {
        "features": features,
        "time_stamps": 1.3e9 + np.arange(T)[None] / 8,
        "linear_velocity": rng.normal(size=(3, T)),
        "angular_velocity": rng.normal(size=(3, T)),
        "K": K,
        "b": np.array(0.5),
        "imu_T_cam": T_BODY_CAMERA,
    }


def changed(**changes: Any) -> dict[str, Any]:
    """The tiny dataset with members replaced or, where None, left out."""
    content = {**dataset(), **changes}
    return {key: value for key, value in content.items() if value is not None}


def save(path, content):
    if path.suffix == ".npz":
        np.savez_compressed(path, **content)
    else:
        np.save(path, np.array(content, dtype=object), allow_pickle=True)
    return path


def load(path):
    return npz.read(path, conventions=Conventions("as-given", "end", "body"))


def assert_same_drive(a, b, *, apart_from=()):
    for name in ("name", "camera", "image_size", "notes"):
        if name not in apart_from:
            assert getattr(a, name) == getattr(b, name)
    for name in ("twist_stamps", "twists", "feature_stamps", "offsets", "ids", "pixels"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), strict=True)


@pytest.fixture
def reference(tmp_path):
    return load(save(tmp_path / "drive.npz", dataset()))


def test_gives_the_arrays_as_a_drive(reference):
    content = dataset()
    assert reference.name == "drive"
    assert reference.notes == ()
    assert reference.ground_truth is None
    assert reference.camera.fx_baseline == 350.0
    np.testing.assert_allclose(reference.camera.T_body_camera, T_BODY_CAMERA, atol=1e-15)
    np.testing.assert_array_equal(
        reference.feature_stamps, 1_300_000_000_000_000_000 + 125_000_000 * np.arange(T)
    )
    np.testing.assert_array_equal(reference.twist_stamps, reference.feature_stamps)
    np.testing.assert_array_equal(reference.twists[:, :3], content["linear_velocity"].T)
    np.testing.assert_array_equal(reference.twists[:, 3:], content["angular_velocity"].T)
    for k in range(T):
        ids, pixels = reference.frame(k)
        seen = np.flatnonzero(np.any(content["features"][:, :, k] != -1, axis=0))
        np.testing.assert_array_equal(ids, seen)
        np.testing.assert_array_equal(pixels, content["features"][:, seen, k].T)


SPELLINGS = {
    "current": {},
    "older": {
        "angular_velocity": None,
        "rotational_velocity": dataset()["angular_velocity"],
        "imu_T_cam": None,
        "cam_T_imu": T_CAMERA_BODY,
        "b": None,
        "baseline": 0.5,
    },
    "course": {
        **dict.fromkeys(dataset()),
        "features": dataset()["features"],
        "v_t": dataset()["linear_velocity"],
        "w_t": dataset()["angular_velocity"],
        "timestamps": dataset()["time_stamps"][0],
        "K_l": K,
        "K_r": K,
        "extL_T_imu": T_CAMERA_BODY,
        "extR_T_imu": se3.inverse(T_LEFT_RIGHT) @ T_CAMERA_BODY,
    },
    "transposed": {
        "linear_velocity": dataset()["linear_velocity"].T,
        "angular_velocity": dataset()["angular_velocity"].T,
        "time_stamps": dataset()["time_stamps"].T,
        "b": np.array([[0.5]]),
    },
    "fortran": {"features": np.asfortranarray(dataset()["features"])},
    "float32": {"features": dataset()["features"].astype(np.float32)},
    "big endian": {"features": dataset()["features"].astype(">f8")},
    "object scalar": {"b": np.array(0.5, dtype=object)},
}


@pytest.mark.parametrize("suffix", [".npz", ".npy"])
@pytest.mark.parametrize("spelling", SPELLINGS)
def test_every_spelling_gives_the_same_drive(tmp_path, reference, spelling, suffix):
    path = save(tmp_path / f"drive{suffix}", changed(**SPELLINGS[spelling]))
    drive = load(path)
    assert_same_drive(drive, reference, apart_from=("notes",))
    assert [note[:15] for note in drive.notes] == ["Read extL_T_imu"] * (spelling == "course")


def test_the_kind_of_file_is_told_by_its_content(tmp_path, reference):
    save(tmp_path / "drive.npz", dataset()).rename(tmp_path / "drive.npy")
    assert_same_drive(load(tmp_path / "drive.npy"), reference)


def test_unknown_keys_are_ignored_with_a_note(tmp_path):
    drive = load(save(tmp_path / "drive.npz", changed(weather=np.array("fine"), colour=1.0)))
    assert drive.notes == ("Ignored keys that are no part of the format: colour, weather.",)


def test_observations_that_are_not_finite_are_left_out_with_a_note(tmp_path):
    features = dataset()["features"]
    m, t = np.argwhere(features[0] != -1)[0]
    whole = load(save(tmp_path / "whole.npz", changed()))
    features[3, m, t] = np.nan
    drive = load(save(tmp_path / "drive.npz", changed(features=features)))
    assert len(drive.ids) == len(whole.ids) - 1
    assert drive.notes[0].startswith("Left out 1 observations")


def test_ground_truth_is_read(tmp_path):
    poses = se3.exp(np.random.default_rng(1).normal(size=(T, 6)))
    drive = load(save(tmp_path / "drive.npz", changed(ground_truth_T_world_body=poses)))
    np.testing.assert_allclose(drive.ground_truth.T_world_body, poses, atol=1e-14)
    assert drive.notes == ()


def test_stamps_that_were_rounded_to_few_bytes_are_told_so(tmp_path):
    content = changed(time_stamps=dataset()["time_stamps"].astype(np.float32))
    path = save(tmp_path / "data.npz", content)
    with pytest.raises(VislamError, match="must increase; float32 rounds such times: store them"):
        npz.read(path)


def test_stamps_are_the_nearest_nanoseconds_of_the_floats():
    seconds = np.array([0.0, 0.1, 1317384506.402997, 1e9 + 0.5])
    # 1317384506.402997 as a double is 1317384506.402997016906...
    np.testing.assert_array_equal(
        nanoseconds(seconds), [0, 100_000_000, 1317384506402997017, 1_000_000_000_500_000_000]
    )


def test_a_damaged_matrix_of_extrinsics_is_mended_once(tmp_path):
    noisy = T_BODY_CAMERA.copy()
    noisy[:3, :3] += 1e-8
    R = load(save(tmp_path / "drive.npz", changed(imu_T_cam=noisy))).camera.T_body_camera[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)


def with_value(array, index, value):
    array = np.array(array)
    array[index] = value
    return array


WRONG = {
    "no stamps": ({"time_stamps": None}, "no time stamps: give it as time_stamps or timestamps"),
    "no angular velocity": (
        {"angular_velocity": None},
        "angular_velocity or rotational_velocity or w_t",
    ),
    "no intrinsics": ({"K": None}, "K or K_l"),
    "no baseline": ({"b": None}, "b or baseline or extR_T_imu"),
    "no extrinsics": ({"imu_T_cam": None}, "imu_T_cam or cam_T_imu or extL_T_imu"),
    "features of three": ({"features": np.zeros((3, 6, T))}, r"features has shape \(3, 6, 5\)"),
    "too few steps": ({"features": np.zeros((4, M, T - 1))}, r"features has shape \(4, 4, 4\)"),
    "flat features": ({"features": np.zeros(4)}, r"features has shape \(4,\)"),
    "text": ({"features": np.array("none")}, "features: holds .*, not"),
    "complex": ({"b": np.array(1j)}, "b: holds"),
    "velocity shape": ({"linear_velocity": np.zeros((3, 4))}, r"\(3, 5\) or \(5, 3\)"),
    "velocity inf": (
        {"linear_velocity": with_value(np.zeros((3, T)), (1, 2), np.inf)},
        r"linear_velocity\[1, 2\] is inf",
    ),
    "velocities that are missing": (
        {"linear_velocity": with_value(np.zeros((3, T)), (0, [0, 1, 3]), np.nan)},
        "3 of 5 velocities are NaN, more than are not: leave all of them out",
    ),
    "angular velocities that are missing": (
        {"angular_velocity": np.full((3, T), np.nan)},
        "5 of 5 angular velocities are NaN, more than are not",
    ),
    "stamps inf": (
        {"time_stamps": with_value(dataset()["time_stamps"], (0, 1), np.inf)},
        r"time_stamps\[0, 1\] is inf",
    ),
    "stamps equal": (
        {"time_stamps": with_value(dataset()["time_stamps"], (0, 3), 1.3e9 + 0.25)},
        r"time_stamps\[3\] is 1300000000.25, not later",
    ),
    "stamps in nanoseconds": ({"time_stamps": np.arange(5) * 1e17}, "UNIX seconds"),
    "stamps before 1970": ({"time_stamps": np.arange(5) - 10.0}, "UNIX seconds"),
    "stamps square": ({"time_stamps": np.zeros((5, 5))}, r"time_stamps has shape \(5, 5\)"),
    "no steps": ({"time_stamps": np.zeros(0)}, "at least one step"),
    "K shape": ({"K": np.eye(4)}, r"K has shape \(4, 4\)"),
    "K nan": ({"K": K * np.nan}, "K.* is nan"),
    "K negative": ({"K": -K}, "intrinsics"),
    "K transposed": ({"K": K.T}, "intrinsics"),
    "K skewed": ({"K": with_value(K, (0, 1), 3.0)}, "intrinsics"),
    "b zero": ({"b": 0.0}, "baseline of 0.0 m"),
    "b negative": ({"b": -0.5}, "must be positive"),
    "b vector": ({"b": np.ones(3)}, r"b has shape \(3,\)"),
    "extrinsics shape": ({"imu_T_cam": np.eye(3)}, r"imu_T_cam has shape \(3, 3\)"),
    "extrinsics scaled": ({"imu_T_cam": np.diag([2.0, 2, 2, 1])}, "no rigid motion"),
    "extrinsics mirrored": ({"imu_T_cam": np.diag([1.0, 1, -1, 1])}, "no rigid motion"),
    "extrinsics transposed": ({"imu_T_cam": T_BODY_CAMERA.T}, "no rigid motion"),
    "right camera alone": ({"b": None, "extR_T_imu": T_CAMERA_BODY}, "only beside extL_T_imu"),
    "right camera above": (
        {
            "b": None,
            "imu_T_cam": None,
            "extL_T_imu": T_CAMERA_BODY,
            "extR_T_imu": se3.exp([-0.3, 0.4, 0.4, 0, 0, 0]) @ T_CAMERA_BODY,
        },
        r"no stereo pair: as .* lies at \[[-0-9., ]+\] m in the left one",
    ),
    "truth shape": ({"ground_truth_T_world_body": np.eye(4)}, r"\(5, 4, 4\)"),
}


@pytest.mark.parametrize("suffix", [".npz", ".npy"])
@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_member_is_one_clear_line(tmp_path, case, suffix):
    changes, message = WRONG[case]
    path = save(tmp_path / f"drive{suffix}", changed(**changes))
    with pytest.raises(VislamError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "neither an .npz"),
        (b"t x y z\n", "neither an .npz"),
        (b"PK\x03\x04 and no more", "cut off or damaged"),
        (b"\x93NUMPY", "cut off or damaged"),
    ],
)
def test_a_file_of_another_kind_is_one_clear_line(tmp_path, content, message):
    path = tmp_path / "drive.npz"
    path.write_bytes(content)
    with pytest.raises(VislamError, match=message):
        load(path)


def test_a_missing_file_or_a_folder_is_one_clear_line(tmp_path):
    with pytest.raises(VislamError, match="No such file"):
        load(tmp_path / "none.npz")
    with pytest.raises(VislamError, match="directory"):
        load(tmp_path)


def test_an_array_in_place_of_a_dict_is_refused(tmp_path):
    np.save(tmp_path / "drive.npy", np.eye(3))
    with pytest.raises(VislamError, match="no dict of arrays"):
        load(tmp_path / "drive.npy")


@pytest.mark.parametrize("suffix", [".npz", ".npy"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
def test_a_file_cut_off_anywhere_is_one_clear_line(tmp_path, suffix, share):
    path = save(tmp_path / f"drive{suffix}", dataset())
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(VislamError, match="cut off or damaged"):
        load(path)


def test_a_flipped_byte_in_an_archive_is_found(tmp_path):
    path = tmp_path / "drive.npz"
    np.savez(path, **dataset())
    data = bytearray(path.read_bytes())
    data[data.index(b"features.npy") + 500] ^= 1
    path.write_bytes(data)
    with pytest.raises(VislamError, match="features: is cut off or damaged"):
        load(path)


def test_a_member_with_fewer_numbers_than_it_says_is_refused(tmp_path):
    path = save(tmp_path / "drive.npz", changed(features=None))
    member = io.BytesIO()
    np.save(member, dataset()["features"])
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("features.npy", member.getvalue()[:-8])
    with pytest.raises(VislamError, match=r"features: its header claims .* cut off or damaged"):
        load(path)


class Touch:
    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return os.system, (f"touch {self.mark}",)


@pytest.mark.parametrize("suffix", [".npz", ".npy"])
def test_a_pickle_inside_never_runs(tmp_path, suffix):
    mark = tmp_path / "ran"
    content = changed(b=np.array(Touch(mark), dtype=object))
    path = save(tmp_path / f"drive{suffix}", content)
    with pytest.raises(VislamError, match="system, which is refused"):
        load(path)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("name", "steps", "tracks"),
    [("03", 1010, 5105), ("0027", 1106, 3950), ("0022", 800, 3220), ("0020", 1104, 260)],
)
def test_real_drives_agree_with_their_dense_arrays(shared_data, name, steps, tracks):
    path = shared_data / f"{name}.npz"
    drive = load(path)
    assert (drive.steps, drive.tracks) == (steps, tracks)
    with np.load(path) as arrays:
        dense = arrays["features"]
    rows, columns = np.nonzero(np.any(dense != -1, axis=0).T)
    np.testing.assert_array_equal(drive.ids, columns)
    np.testing.assert_array_equal(drive.pixels, dense[:, columns, rows].T.astype(np.float32))
    np.testing.assert_array_equal(np.diff(drive.offsets), np.bincount(rows, minlength=steps))


def test_the_largest_drive_takes_a_fraction_of_the_memory_of_its_dense_array(shared_data):
    # ru_maxrss would count the parent before exec, too.
    program = (
        "import sys; from pathlib import Path\n"
        "from vislam_ros.data.datasets import npz\n"
        "def kilobytes(name):\n"
        "    lines = Path('/proc/self/status').read_text().splitlines()\n"
        "    return next(line.split()[1] for line in lines if line.startswith(name))\n"
        "before = kilobytes('VmRSS')\n"
        "drive = npz.read(Path(sys.argv[1]))\n"
        "print(drive.steps, drive.tracks, len(drive.ids), before, kilobytes('VmHWM'))\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", program, shared_data / "10_synthetic.npz"],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    steps, tracks, observations, before, peak = map(int, result.stdout.split())
    assert observations == 185295
    dense = 8 * 4 * tracks * steps / 1024
    assert peak - before < dense / 8


NO_VELOCITY = np.full((3, T), np.nan)


@pytest.mark.parametrize("velocity", [None, NO_VELOCITY], ids=["missing", "NaN"])
def test_without_velocities_the_gyroscope_alone_tells_the_motion(tmp_path, reference, velocity):
    drive = load(save(tmp_path / "drive.npz", changed(linear_velocity=velocity)))
    assert not drive.measures_velocity
    np.testing.assert_array_equal(drive.twists, reference.moved_by("gyro").twists)
    (note,) = drive.notes
    assert note.endswith("the gyroscope alone tells the motion.")
