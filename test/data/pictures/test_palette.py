# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import pytest
from matplotlib.figure import Figure

from vislam_ros.data.pictures import palette


@pytest.mark.parametrize(
    ("ends", "labels"),
    [((0.4, 0.9), ["0.5", "0.6", "0.7"]), ((0.55, 8.0), ["0.6", "1", "2"]), ((1, 3000), ["100"])],
)
def test_a_logarithmic_axis_has_plain_numbers(
    ends: tuple[float, float], labels: list[str]
) -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.plot([1, 2], ends)
    axes.set_yscale("log")
    palette.plain_numbers(axes.yaxis)
    figure.draw_without_rendering()
    drawn = [text.get_text() for text in axes.get_yticklabels(which="both")]
    assert set(labels) <= set(drawn)
    assert not any("mathdefault" in text for text in drawn)
