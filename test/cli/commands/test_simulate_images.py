# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam simulate --images``: what it writes, tells and refuses."""

import dataclasses

import pytest

from vislam_ros.cli.grammar import shared
from vislam_ros.cli.main import main
from vislam_ros.cli.parser import build_parser
from vislam_ros.data.simulation.images.simulated import ImageSettings
from vislam_ros.data.trajectory import read_tum

# Of these the defaults will do.
WITHOUT_FLAG = {"scale", "image_noise", "gyro_noise_density"}


def simulate(*words):
    return main(["simulate", *map(str, words)])


def error_line(capsys, *words):
    capsys.readouterr()
    assert simulate(*words) == 1
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_images_are_written_and_told(tmp_path, capsys):
    city, again = tmp_path / "city", tmp_path / "again"
    flags = ("--images", "--seconds", 0.2, "--rate", 10, "--moving", 1, "--seed", 3)
    assert simulate(city, *flags, "--scene", "street") == 0
    out = capsys.readouterr().out
    assert out == f"{city}: 3 stereo frames of a street; truth in {city / 'truth.tum'}\n"
    assert len(list((city / "mav0/cam1/data").iterdir())) == 3

    # Along a record, to its end, in another scene.
    assert simulate(again, *flags[:1], "--along", city / "truth.tum", "--scene", "room") == 0
    first, other = (read_tum(path / "truth.tum") for path in (city, again))
    assert other.stamps[0] == first.stamps[0]
    assert other.stamps[-1] == first.stamps[-1]
    assert len(other) == 5


def test_an_output_that_exists_is_kept_unless_forced(tmp_path, capsys):
    flags = ("--images", "--scene", "room", "--seconds", 0.1)
    assert simulate(tmp_path / "hall", *flags) == 0
    assert "hall: exists already" in error_line(capsys, tmp_path / "hall", *flags)
    assert simulate(tmp_path / "hall", *flags, "--force") == 0


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--images", "--steps", 20), "--steps: is of tracks: leave it or --images out"),
        (("--images", "--pixel-noise", 0), "--pixel-noise: is of tracks"),
        (("--scene", "room"), "--scene: is of images: add --images"),
        (("--exposure",), "--exposure: is of images: add --images"),
    ],
)
def test_a_flag_of_the_other_kind_is_refused(words, line, tmp_path, capsys):
    assert line in error_line(capsys, tmp_path / "out.npz", *words)
    assert list(tmp_path.iterdir()) == []


def test_each_setting_has_a_flag_that_tells_its_default(capsys):
    with pytest.raises(SystemExit):
        main(["simulate", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    arguments = build_parser().parse_args(["simulate", "city", "--images"])
    for field in dataclasses.fields(ImageSettings):
        if field.name in WITHOUT_FLAG:
            assert not hasattr(arguments, field.name)
            continue
        assert getattr(arguments, field.name) is None
        if field.default is False:
            continue
        values = field.default if isinstance(field.default, tuple) else (field.default,)
        told = " ".join(value if isinstance(value, str) else f"{value:g}" for value in values)
        assert f"({told})" in text, field.name


def test_scenes_are_those_of_the_simulation():
    (scene,) = (field for field in dataclasses.fields(ImageSettings) if field.name == "scene")
    assert scene.metadata["choices"] == shared.SCENES
