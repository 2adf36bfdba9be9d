# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the package declares about itself agrees with itself and with what it imports."""

import ast
import re
import sys
import types
from pathlib import Path
from typing import Any

import pytest
from catkin_pkg.package import parse_package
from packaging.requirements import Requirement
from places import REPOSITORY

import vislam_ros

# The ROS packages that each wheel of the extra `ros` brings.
ROS_WHEELS = {
    "ros-jazzy-rclpy": {"builtin_interfaces", "rcl_interfaces", "rclpy", "rosgraph_msgs"},
    "ros-jazzy-common-interfaces": {
        "diagnostic_msgs",
        "geometry_msgs",
        "nav_msgs",
        "sensor_msgs",
        "std_msgs",
        "std_srvs",
    },
}
# Not among the wheels; imported only where it exists.
FULL_ROS_ONLY = {"ament_index_python", "launch", "launch_ros", "tf2_msgs"}
# rosdep keys that are not "python3-" and the name on the package index.
ROSDEP_KEYS = {
    "mcap": "python3-mcap-pip",
    "opencv-python-headless": "python3-opencv",
    "pyyaml": "python3-yaml",
    "rosbags": "python3-rosbags-pip",
}
# Test tools that rosdep has no key for; tests that want them skip without.
PIP_ONLY = {"evo", "playwright"}
# Extras whose packages are imported only where they are asked for; rosdep need not know them.
OPTIONAL_EXTRAS = ("dask", "fuzz", "peers", "report", "view")
IMPORT_NAMES = {"opencv-python-headless": "cv2", "pyyaml": "yaml", "rerun-sdk": "rerun"}
# The package itself, and a module that type checkers alone know.
NEEDS_NO_DECLARATION = {"vislam_ros", "_typeshed"}


@pytest.fixture
def setup_arguments(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Arguments that setup.py hands to setuptools, which need not be installed for it."""
    arguments: dict[str, Any] = {}
    setuptools = types.ModuleType("setuptools")
    setuptools.setup = arguments.update  # type: ignore[attr-defined]
    setuptools.find_packages = lambda **_: []  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "setuptools", setuptools)
    monkeypatch.chdir(REPOSITORY)
    exec(compile((REPOSITORY / "setup.py").read_text(), "setup.py", "exec"), {})
    return arguments


@pytest.fixture(scope="module")
def manifest() -> Any:
    return parse_package(str(REPOSITORY / "package.xml"))


def project_names(requirements: list[str]) -> set[str]:
    """'ros-jazzy-rclpy[fastrtps]>=7.1' -> 'ros-jazzy-rclpy', in lower case."""
    return {re.split(r"[\[<>=!~; ]", text, maxsplit=1)[0].lower() for text in requirements}


def rosdep_keys(requirements: list[str]) -> set[str]:
    names = project_names(requirements) - PIP_ONLY
    return {ROSDEP_KEYS.get(name, f"python3-{name}") for name in names}


def third_party_imports(folder: Path) -> dict[str, str]:
    """Top-level modules imported below a folder that are neither ours nor the standard library's.

    Returns the module names, each with one file that imports it.
    """
    found: dict[str, str] = {}
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                names = [node.module]
            else:
                continue
            for name in names:
                found.setdefault(name.split(".")[0], str(path.relative_to(REPOSITORY)))
    return {
        name: where
        for name, where in found.items()
        if name not in NEEDS_NO_DECLARATION and name not in sys.stdlib_module_names
    }


def test_package_xml_is_valid_without_warnings() -> None:
    warnings: list[str] = []
    manifest = parse_package(str(REPOSITORY / "package.xml"), warnings=warnings)
    assert not warnings
    assert manifest.package_format == 3
    assert manifest.get_build_type() == "ament_python"
    assert (REPOSITORY / manifest.licenses[0].file).is_file()


def test_name_version_licence_and_people_are_the_same_everywhere(
    setup_arguments: dict[str, Any], manifest: Any
) -> None:
    assert setup_arguments["name"] == manifest.name == "vislam_ros"
    assert setup_arguments["version"] == manifest.version == vislam_ros.__version__
    assert [setup_arguments["license"]] == [str(text) for text in manifest.licenses]
    (maintainer,) = manifest.maintainers
    assert setup_arguments["maintainer"] == maintainer.name
    assert setup_arguments["maintainer_email"] == maintainer.email


def test_setup_py_and_package_xml_declare_the_same_dependencies(
    setup_arguments: dict[str, Any], manifest: Any
) -> None:
    wheels = project_names(setup_arguments["extras_require"]["ros"])
    assert wheels == set(ROS_WHEELS)
    from_setup = rosdep_keys(setup_arguments["install_requires"]).union(
        FULL_ROS_ONLY, *(ROS_WHEELS[wheel] for wheel in wheels)
    )
    assert {depend.name for depend in manifest.exec_depends} == from_setup


def test_setup_py_and_package_xml_declare_the_same_test_tools(
    setup_arguments: dict[str, Any], manifest: Any
) -> None:
    from_setup = rosdep_keys(setup_arguments["extras_require"]["test"])
    assert {depend.name for depend in manifest.test_depends} == from_setup


def test_every_third_party_import_is_declared(setup_arguments: dict[str, Any]) -> None:
    python = project_names(setup_arguments["install_requires"])
    extras = setup_arguments["extras_require"]
    optional = project_names([text for extra in OPTIONAL_EXTRAS for text in extras[extra]])
    declared = {IMPORT_NAMES.get(name, name) for name in python | optional}.union(
        FULL_ROS_ONLY, *ROS_WHEELS.values()
    )
    imported = third_party_imports(REPOSITORY / "vislam_ros")
    undeclared = {name: where for name, where in imported.items() if name not in declared}
    assert not undeclared, "add these to setup.py, package.xml and ROS_WHEELS or ROSDEP_KEYS"


def test_every_declared_python_dependency_is_imported(setup_arguments: dict[str, Any]) -> None:
    python = project_names(setup_arguments["install_requires"])
    declared = {IMPORT_NAMES.get(name, name) for name in python}
    assert declared <= set(third_party_imports(REPOSITORY / "vislam_ros"))


@pytest.mark.parametrize("python", ["3.10", "3.11", "3.12", "3.13"])
def test_constraints_pin_every_dependency_to_one_version_that_setup_py_allows(
    setup_arguments: dict[str, Any], python: str
) -> None:
    lists = [setup_arguments["install_requires"], *setup_arguments["extras_require"].values()]
    declared = [Requirement(text) for requirements in lists for text in requirements]
    pins = [
        Requirement(line)
        for line in (REPOSITORY / "constraints.txt").read_text().splitlines()
        if not line.startswith("#")
    ]

    def holds(requirement: Requirement) -> bool:
        marker = requirement.marker
        return marker is None or marker.evaluate({"python_version": python})

    for requirement in filter(holds, declared):
        name = requirement.name.lower()
        (pin,) = (pin for pin in pins if pin.name == name and holds(pin))
        (exactly,) = pin.specifier
        assert exactly.operator == "=="
        assert requirement.specifier.contains(exactly.version), requirement


def test_every_executable_is_a_function_of_the_package(setup_arguments: dict[str, Any]) -> None:
    for line in setup_arguments["entry_points"]["console_scripts"]:
        module, function = line.split(" = ")[1].split(":")
        path = REPOSITORY / Path(*module.split(".")).with_suffix(".py")
        tree = ast.parse(path.read_text())
        names = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert function in names, line


def test_everything_that_is_installed_beside_the_modules_exists(
    setup_arguments: dict[str, Any],
) -> None:
    installed = {
        f"{folder}/{Path(name).name}": REPOSITORY / name
        for folder, names in setup_arguments["data_files"]
        for name in names
    }
    assert all(source.is_file() for source in installed.values())
    assert "share/ament_index/resource_index/packages/vislam_ros" in installed
    assert "share/vislam_ros/package.xml" in installed
    for name in ("ekf.yaml", "vislam.rviz", "vislam.foxglove.json"):
        assert f"share/vislam_ros/config/{name}" in installed
    assert "share/vislam_ros/launch/vislam.launch.py" in installed


def test_every_folder_of_the_package_is_a_package_of_its_own() -> None:
    # What the launch system runs as a file is installed beside the package.
    paths = (REPOSITORY / "vislam_ros").rglob("*.py")
    folders = {path.parent for path in paths if not path.name.endswith(".launch.py")}
    assert len(folders) > 10
    # setuptools installs no folder without it, and nothing below.
    assert not [folder for folder in folders if not (folder / "__init__.py").is_file()]


def test_every_python_file_names_its_licence() -> None:
    folders = ("vislam_ros", "test", "tools")
    paths = [path for folder in folders for path in (REPOSITORY / folder).rglob("*.py")]
    first_lines = [
        "# Copyright the vislam_ros contributors",
        "# SPDX-License-Identifier: Apache-2.0",
    ]
    for path in [*paths, REPOSITORY / "setup.py"]:
        lines = [line for line in path.read_text().splitlines()[:3] if not line.startswith("#!")]
        assert lines[:2] == first_lines, path
