# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from array import array
from pathlib import Path

import numpy as np
import pytest

from vislam_ros.data.files.parameter_file import (
    Parameters,
    node_parameters,
    read_parameters,
    write_parameters,
)
from vislam_ros.errors import VislamError


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "params.yaml"
    path.write_text(text)
    return path


def test_sections_names_and_values_are_read(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        """\
# a comment
/slam_node:
  ros__parameters:
    estimator: robocentric
    process_variance: 1e-10
    seed: 3
    planar: false
    pixel_variance: [1.0, 1.0, 1.0, 1.0]
    gate: {chi2: 16.27, pixel: {limit: 5.0}}
imu_prediction_node:
  ros__parameters:
""",
    )
    assert read_parameters(path) == {
        "slam_node": {
            "estimator": "robocentric",
            "process_variance": 1e-10,
            "seed": 3,
            "planar": False,
            "pixel_variance": [1.0, 1.0, 1.0, 1.0],
            "gate.chi2": 16.27,
            "gate.pixel.limit": 5.0,
        },
        "imu_prediction_node": {},
    }


@pytest.mark.parametrize("text", ["1e-10", "1.5e3", "-2E+4", ".5e1", "1.e2"])
def test_numbers_with_an_exponent_are_numbers_as_in_ros(tmp_path: Path, text: str) -> None:
    path = written(tmp_path, f"n:\n  ros__parameters:\n    a: {text}\n    b: '{text}'\n")
    assert read_parameters(path)["n"] == {"a": float(text), "b": text}


def test_wildcard_applies_first_and_namespaces_do_not_matter(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        """\
/robot/slam_node:
  ros__parameters: {seed: 2}
/**:
  ros__parameters: {seed: 1, time_jump: 0.5}
robot:
  imu_prediction_node:
    ros__parameters: {time_jump: 2.0}
""",
    )
    parameters = read_parameters(path)
    assert node_parameters(parameters, "slam_node") == {"seed": 2, "time_jump": 0.5}
    assert node_parameters(parameters, "imu_prediction_node") == {"seed": 1, "time_jump": 2.0}
    assert node_parameters(parameters, "recorder_node") == {"seed": 1, "time_jump": 0.5}


ROBOTS: Parameters = {
    "**": {"seed": 1},
    "robot1/slam_node": {"chi2_gate": 9.0},
    "slam_node": {"chi2_gate": 4.0, "time_jump": 2.0},
    "**/slam_node": {"chi2_gate": 1.0, "max_active": 7},
    "robot2/slam_node": {"chi2_gate": 16.0},
}


@pytest.mark.parametrize(("namespace", "gate"), [("robot1", 9.0), ("/robot2/", 16.0)])
def test_the_robot_that_is_told_counts_over_what_is_for_all(namespace: str, gate: float) -> None:
    expected = {"seed": 1, "max_active": 7, "time_jump": 2.0, "chi2_gate": gate}
    assert node_parameters(ROBOTS, "slam_node", namespace) == expected


@pytest.mark.parametrize("namespace", ["", "/robot3"])
def test_robots_that_differ_are_named_where_none_of_them_is_told(namespace: str) -> None:
    two = {name: values for name, values in ROBOTS.items() if name != "slam_node"}
    with pytest.raises(
        VislamError, match=r"^/robot1/slam_node and /robot2/slam_node differ in chi"
    ):
        node_parameters(two, "slam_node", namespace)
    two["robot1/slam_node"] = two["robot2/slam_node"]
    assert node_parameters(two, "slam_node", namespace)["chi2_gate"] == 16.0


def test_sections_for_all_nodes_of_a_robot_count_for_that_robot() -> None:
    robots: Parameters = {
        "robot1/slam_node": {"chi2_gate": 9.0},
        "robot1/**": {"chi2_gate": 4.0, "seed": 1},
        "robot2/*": {"seed": 2},
    }
    assert node_parameters(robots, "slam_node", "robot1") == {"chi2_gate": 9.0, "seed": 1}
    assert node_parameters(robots, "slam_node", "robot2") == {"seed": 2}
    with pytest.raises(VislamError, match=r"^/robot1/slam_node and /robot2/slam_node differ in"):
        node_parameters(robots, "slam_node")
    del robots["robot2/*"]
    assert node_parameters(robots, "imu_prediction_node") == {"chi2_gate": 4.0, "seed": 1}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ": holds no parameters"),
        ("- 1\n", ", line 1: expected a mapping of node names"),
        ("a: [1\nb: 2\n", ", line 2: not YAML"),
        ("a:\n\tb: 1\n", ", line 2: not YAML"),
        ("slam_node: 5\n", ", line 1: expected a mapping of ros__parameters"),
        ("slam_node:\n  seed: 5\n", ", line 2: expected a mapping"),
        ("n:\n  ros__parameters: 3\n", ", line 2: expected a mapping of parameter names"),
        ("n:\n  ros__parameters: {a: 1}\n  b: 2\n", ", line 1: n holds ros__parameters and more"),
        ("n:\n  ros__parameters:\n    a: 1\n    a: 2\n", ", line 4: a is here for the second"),
        ("n:\n  ros__parameters:\n    a: null\n", ", line 3: a is None: a parameter is"),
        ("n:\n  ros__parameters:\n    a: [1, 2.0]\n", ", line 3: a is .1, 2.0.: a parameter is"),
        ("n:\n  ros__parameters:\n    a: [[1], [2]]\n", ", line 3: a is "),
        ("n:\n  ros__parameters:\n    a: 2020-01-01\n", ", line 3: a is "),
        ("n:\n  ros__parameters:\n    a: 2020-99-01\n", ", line 3: a is '2020-99-01'"),
        ("n:\n  ros__parameters:\n    a: !!python/name:os.system x\n", ", line 3: a is "),
        ("n:\n  ros__parameters:\n    a: *missing\n", ", line 3: not YAML"),
        ("a: \x00\n", ": not YAML"),
        ("n:\n  ros__parameters:\n    a: &x 1\n    b: *x\n", ", line 4: not YAML: an alias"),
        ("n:\n  ros__parameters:\n    a: !!timestamp x\n", ", line 3: a is 'x'"),
        ("n:\n  ros__parameters:\n    a: !!bool x\n", ", line 3: a is 'x'"),
    ],
)
def test_bad_files_are_refused_with_their_line(tmp_path: Path, text: str, message: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(VislamError, match=message) as caught:
        read_parameters(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("levels", "fits"), [(18, True), (19, False)])
def test_nesting_has_an_end(tmp_path: Path, levels: int, fits: bool) -> None:
    nested = "{a: " * (levels - 1) + "1" + "}" * (levels - 1)
    path = written(tmp_path, f"n: {{ros__parameters: {nested}}}\n")
    if fits:
        assert list(read_parameters(path)["n"].values()) == [1]
    else:
        with pytest.raises(VislamError, match="line 1: not YAML: nested too deeply"):
            read_parameters(path)


def test_a_missing_or_binary_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VislamError, match="No such file"):
        read_parameters(tmp_path / "none.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\xfd")
    with pytest.raises(VislamError, match="not a text file"):
        read_parameters(tmp_path / "binary.yaml")


def test_what_is_written_reads_back(tmp_path: Path) -> None:
    parameters: Parameters = {
        "**": {"use_sim_time": False},
        "slam_node": {
            "process_variance": 1e-10,
            "huge": 1e300,
            "third": 1 / 3,
            "text_that_looks_like_a_number": "1e5",
            "text_that_looks_like_a_flag": "no",
            "seed": 3,
            "names": ["a", "b: c"],
        },
        "recorder_node": {},
    }
    write_parameters(tmp_path / "params.yaml", parameters)
    assert read_parameters(tmp_path / "params.yaml") == parameters
    assert (tmp_path / "params.yaml").read_text().startswith("/**:\n  ros__parameters:\n")


def test_tuples_and_arrays_are_written_as_lists(tmp_path: Path) -> None:
    values = {
        "tuple": (1.0, 2.0),
        "array": array("d", [0.5]),
        "ndarray": np.arange(3),
        "scalar": np.float64(0.25),
    }
    write_parameters(tmp_path / "params.yaml", {"n": values})
    assert read_parameters(tmp_path / "params.yaml")["n"] == {
        "tuple": [1.0, 2.0],
        "array": [0.5],
        "ndarray": [0, 1, 2],
        "scalar": 0.25,
    }
