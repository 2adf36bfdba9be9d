# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A right principal point that is off is named, and not the baseline, the axes or the sides."""

import numpy as np
import pytest
from places import SHARED_CASES

from vislam_ros.data.datasets import npz
from vislam_ros.errors import VislamError

CASE = SHARED_CASES / "02_K_r_ignored"

pytestmark = pytest.mark.skipif(not CASE.is_dir(), reason=f"{CASE} is not there")


def shifted(tmp_path, by, name="kf.npy"):
    """Read a course file with the right principal point shifted along the rows."""
    fields = np.load(CASE / name, allow_pickle=True).item()
    fields["K_r"] = fields["K_r"] + [[0, 0, by], [0, 0, 0], [0, 0, 0]]
    np.save(tmp_path / "drive.npy", fields, allow_pickle=True)
    return npz.read(tmp_path / "drive.npy")


def off(drive):
    return [each for each in drive.findings if each.name == "right_camera"]


@pytest.mark.parametrize("by", [-30.0, -5.0, 5.0, 30.0])
def test_it_is_named_with_both_values(tmp_path, by):
    (finding,) = off(shifted(tmp_path, by))
    assert finding.words.startswith(f"cx of K_r is {320.7 + by:.6g} px beside 320.7 of K_l")
    assert finding.advice == "check K_r"
    assert not finding.is_repaired


@pytest.mark.parametrize("name", ["k.npy", "kf.npy"])
def test_one_that_is_right_is_not(tmp_path, name):
    assert not off(shifted(tmp_path, 0.0, name))


def test_it_is_named_where_wrong_depths_fit_axes_that_cannot_be(tmp_path, monkeypatch):
    def refuses(*_):
        raise VislamError("drive.npy: extL_T_imu and extR_T_imu are no stereo pair")

    monkeypatch.setattr(npz, "choose_reading", refuses)
    with pytest.raises(VislamError, match=r"drive.npy: cx of K_r is 315.7 px .*: check K_r$"):
        shifted(tmp_path, -5.0)
    with pytest.raises(VislamError, match="are no stereo pair"):
        shifted(tmp_path, 0.0)
