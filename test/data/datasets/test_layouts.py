# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Features in another order are read where it is no guess, and a file may have none."""

import dataclasses

import numpy as np
import pytest
from course_files import course_content, dense_features, save_course_file
from places import SHARED_CASES
from rewriting import assert_same

from vislam_ros.data.datasets import npz
from vislam_ros.data.datasets.conventions import Conventions
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.solving import solve
from vislam_ros.errors import VislamError

STEPS = 30


@pytest.fixture(scope="module")
def drive() -> Drive:
    """A simulated drive with smooth twists."""
    return simulate(
        SimulationSettings(
            steps=STEPS, landmarks=60, velocity_noise_std=0.01, angular_velocity_noise_std=1e-3
        )
    ).drive


def read(path, content, **changes):
    """Drive of an archive or a dict in a file, some members replaced, or left out where None."""
    content = {**content, **changes}
    content = {name: value for name, value in content.items() if value is not None}
    if path.suffix == ".npz":
        np.savez_compressed(path, **content)
    else:
        save_course_file(path, content)
    told = Conventions("as-given", "end", "body", "imu-to-optical")
    return npz.read(path, conventions=told)


@pytest.mark.parametrize("suffix", [".npz", ".npy"])
@pytest.mark.parametrize("fortran", [False, True])
@pytest.mark.parametrize("order", [(0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)])
def test_an_order_that_leaves_no_doubt_is_read(tmp_path, drive, suffix, fortran, order):
    path = tmp_path / f"drive{suffix}"
    straight = read(path, course_content(drive))
    features = dense_features(drive).transpose(order)
    features = np.asfortranarray(features) if fortran else np.ascontiguousarray(features)
    other = read(path, course_content(drive), features=features)
    names = ", ".join(("4", "M", "T")[axis] for axis in order)
    assert other.notes == (f"Read features of shape {features.shape} as ({names}).",)
    assert_same(dataclasses.replace(other, notes=()), straight)


@pytest.mark.parametrize("tracks", [4, STEPS])
def test_the_documented_order_is_taken_where_it_fits_and_a_guess_is_refused(
    tmp_path, drive, tracks
):
    features = dense_features(drive)[:, :tracks]
    path = tmp_path / "drive.npz"
    assert read(path, course_content(drive), features=features).notes == ()
    for order in ((2, 0, 1), (1, 2, 0)):
        turned = features.transpose(order)
        if turned.shape[0] == 4 and turned.shape[2] == STEPS:
            continue
        with pytest.raises(VislamError, match="and which axis is which cannot be told"):
            read(path, course_content(drive), features=turned)


@pytest.mark.parametrize("estimator", ["robocentric", "joint", "block_diagonal", "dead_reckoning"])
@pytest.mark.parametrize("suffix", [".npz", ".npy"])
def test_a_file_without_features_gives_dead_reckoning(tmp_path, drive, suffix, estimator):
    path = tmp_path / f"drive{suffix}"
    with_features = read(path, course_content(drive))
    without = read(path, course_content(drive), features=None)
    assert without.notes == ("There are no features: what is left is dead reckoning.",)
    assert (without.steps, len(without.ids), without.image_size) == (STEPS, 0, (1, 1))
    np.testing.assert_array_equal(without.twists, with_features.twists)
    solution = solve(without, estimator=estimator)
    positions, reckoned = solution.trajectory.positions, solution.dead_reckoning.positions
    assert len(positions) == STEPS
    way = np.linalg.norm(np.diff(reckoned, axis=0), axis=1).sum()
    assert way > 10.0
    assert np.abs(positions - reckoned).max() < 0.01 * way


def test_a_course_file_without_features_is_solved():
    path = SHARED_CASES / "14_course_layouts" / "v_nofeat.npy"
    if not path.is_file():
        pytest.skip(f"needs 14_course_layouts, which is not in {SHARED_CASES}")
    drive = npz.read(path)
    assert drive.notes[0] == "There are no features: what is left is dead reckoning."
    assert len(solve(drive).trajectory) == drive.steps > 0


def test_zeros_in_place_of_minus_one_are_unobserved_with_a_note(tmp_path, drive):
    path = tmp_path / "drive.npz"
    straight = read(path, course_content(drive))
    features = dense_features(drive)
    features[features == -1] = 0.0
    zeros = read(path, course_content(drive), features=features)
    entries = features[0].size
    (note,) = zeros.notes
    assert note.startswith(f"{entries - len(drive.ids)} of {entries} entries of features (")
    assert note.endswith("are 0 0 0 0: read as unobserved, which is -1 -1 -1 -1.")
    assert_same(dataclasses.replace(zeros, notes=()), straight)


def test_features_of_zeros_alone_are_refused(tmp_path, drive):
    content = course_content(drive)
    with pytest.raises(VislamError, match="features holds zeros alone: write the observations"):
        read(tmp_path / "empty.npz", content, features=np.zeros_like(dense_features(drive)))
