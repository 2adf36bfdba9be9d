# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from vislam_ros.core.columns import Column, Estimate, Quantity

WIND = Quantity("wind", "m/s", "of the air", ("x", "y"))
SCALE = Quantity("wheel_scale", "", "by which the wheel is too large")
LEVEL = Quantity("level_std", "px", "noise", has_std=False)


def test_a_quantity_has_a_column_for_each_component_and_then_for_its_deviation():
    assert WIND.names == ("wind_x", "wind_y")
    assert WIND.std_names == ("wind_std_x", "wind_std_y")
    assert [column.name for column in WIND.columns] == [*WIND.names, *WIND.std_names]
    assert SCALE.names + SCALE.std_names == ("wheel_scale", "wheel_scale_std")
    assert LEVEL.columns == (Column("level_std", float, "px", "noise"),)


def test_people_read_names_as_words_with_their_unit():
    assert [column.label for column in WIND.columns][2] == "wind std x [m/s]"
    assert SCALE.label == "wheel scale"


def test_an_estimate_gives_plain_numbers_by_column():
    numbers = Estimate(WIND, np.array([1.0, 2.0]), np.array([0.1, 0.2])).numbers()
    assert numbers == {"wind_x": 1.0, "wind_y": 2.0, "wind_std_x": 0.1, "wind_std_y": 0.2}
    assert Estimate(SCALE, 2, 1).numbers() == {"wheel_scale": 2.0, "wheel_scale_std": 1.0}
    assert {type(number) for number in numbers.values()} == {float}


@pytest.mark.parametrize("estimate", [Estimate(WIND, [1.0, 2.0]), Estimate(LEVEL, 1.0, 0.1)])
def test_an_estimate_of_another_size_than_its_quantity_is_an_error(estimate):
    with pytest.raises(ValueError, match=r"2 numbers for the columns (wind_x|level)"):
        estimate.numbers()
