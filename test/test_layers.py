# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Imports only point down, from cli to nodes to data to frontend to core.

Neither core nor frontend knows ROS or files.

A room is a folder; a module that lies in a layer beside its rooms (``core/slam.py``) is a room of
its own. The rooms of the whole house, and those of ``tools``, can be put in an order.
"""

import ast
import graphlib
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from places import REPOSITORY

PACKAGE = REPOSITORY / "vislam_ros"
LAYERS = ("core", "frontend", "data", "nodes", "cli")
ROS = {
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rclpy",
    "rosgraph_msgs",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "tf2_msgs",
}
FILES = {"glob", "io", "os", "pathlib", "shutil", "subprocess", "tempfile"}


def sources(layer: str) -> list[Path]:
    return sorted((PACKAGE / layer).rglob("*.py"))


def imports(path: Path) -> set[str]:
    """Full names of all modules that a file imports, also inside functions."""
    names: set[str] = set()
    package = ".".join(path.relative_to(PACKAGE.parent).parent.parts)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.rsplit(".", node.level - 1)[0] + "." if node.level else ""
            module = (above + (node.module or "")).rstrip(".")
            names.update({module, *(f"{module}.{alias.name}" for alias in node.names)})
    return names


def loaded_by(modules: list[str]) -> set[str]:
    """Top-level modules that a fresh Python holds after it has imported the given ones."""
    program = (
        "import importlib, json, sys\n"
        f"for name in {modules!r}: importlib.import_module(name)\n"
        "print(json.dumps(sorted({name.split('.')[0] for name in sys.modules})))"
    )
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert result.returncode == 0, result.stderr
    return set(json.loads(result.stdout))


def module_names(layer: str) -> list[str]:
    return [
        ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
        for path in sources(layer)
        if path.name not in ("__init__.py", "__main__.py")
    ]


def room_of(path: Path) -> str:
    """Dotted name of the room that a file stands in; a package's face stands in its room."""
    parts = path.relative_to(REPOSITORY).with_suffix("").parts
    inside = parts[:-1] if parts[0] == "tools" or len(parts) > 3 else parts
    return ".".join(part for part in inside if part != "__init__")


def rooms(folder: str, prefix: str) -> dict[str, set[str]]:
    """Each room below a folder, with the rooms that it imports; ``prefix`` is not in imports.

    The face of the whole package is no room: it names what users import, and imports it for them.
    """
    paths = sorted(set((REPOSITORY / folder).rglob("*.py")) - {PACKAGE / "__init__.py"})
    home = {
        ".".join(path.relative_to(REPOSITORY).with_suffix("").parts)
        .removesuffix(".__init__")
        .removeprefix(prefix): room_of(path)
        for path in paths
    }
    arrows: dict[str, set[str]] = {room: set() for room in home.values()}
    for path in paths:
        arrows[room_of(path)].update(home[name] for name in imports(path) if name in home)
    return {room: others - {room} for room, others in arrows.items()}


@pytest.mark.parametrize(("folder", "prefix"), [("vislam_ros", ""), ("tools", "tools.")])
def test_there_is_no_circle_among_rooms(folder: str, prefix: str) -> None:
    arrows = rooms(folder, prefix)
    assert sum(map(len, arrows.values())) > 5
    graphlib.TopologicalSorter(arrows).prepare()


def test_no_file_is_longer_than_400_lines_and_no_folder_fuller_than_15_modules() -> None:
    paths = [
        path
        for folder in ("vislam_ros", "tools", "test")
        for path in (REPOSITORY / folder).rglob("*.py")
    ]
    lines = {str(path): len(path.read_text().splitlines()) for path in paths}
    assert not {path: count for path, count in lines.items() if count > 400}
    modules = Counter(path.parent for path in paths if path.name != "__init__.py")
    assert not {folder: count for folder, count in modules.items() if count > 15}


@pytest.mark.parametrize(("position", "layer"), list(enumerate(LAYERS)))
def test_a_layer_imports_only_itself_and_what_lies_below(position: int, layer: str) -> None:
    assert sources(layer)
    above = tuple(f"vislam_ros.{name}" for name in LAYERS[position + 1 :])
    for path in sources(layer):
        upward = {name for name in imports(path) if name.startswith(above)} if above else set()
        assert not upward, path


def test_the_core_imports_neither_ros_nor_anything_that_touches_files() -> None:
    # "_typeshed" is there for type checkers alone.
    allowed = {"_typeshed", "numba", "numpy", "scipy", "vislam_ros"}
    allowed |= sys.stdlib_module_names - FILES
    for path in sources("core"):
        assert {name.split(".")[0] for name in imports(path)} <= allowed, path
        calls = [
            node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)
        ]
        opened = [
            call for call in calls if isinstance(call.func, ast.Name) and call.func.id == "open"
        ]
        assert not opened, path


def test_data_imports_no_ros() -> None:
    for path in sources("data"):
        assert not {name.split(".")[0] for name in imports(path)} & ROS, path


def test_core_and_data_run_without_loading_ros() -> None:
    assert not loaded_by(module_names("core") + module_names("data")) & ROS


def test_the_command_line_starts_without_loading_ros() -> None:
    assert not loaded_by(["vislam_ros.cli.main"]) & ROS
