# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import sys
import sysconfig
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "vislam_ros"

# setup.cfg sends executables to lib/vislam_ros, where `ros2 run` looks, and colcon wants them
# there. Pips that run this file instead of building a wheel (before 23.1; with -e until 25.3)
# would follow it too, and a virtual environment would have no executable on its PATH.
SCRIPT_OPTIONS = {"install": "--install-scripts", "develop": "--script-dir"}
command = sys.argv[1] if len(sys.argv) > 1 else ""
if command in SCRIPT_OPTIONS and "--editable" not in sys.argv and sys.prefix != sys.base_prefix:
    sys.argv += [SCRIPT_OPTIONS[command], sysconfig.get_path("scripts")]

setup(
    name=PACKAGE,
    version="0.1.0",
    description="EKF visual-inertial SLAM from stereo feature tracks and IMU twist for ROS 2",
    author="vislam_ros contributors",
    author_email="maintainers@vislam-ros.example",
    maintainer="vislam_ros contributors",
    maintainer_email="maintainers@vislam-ros.example",
    license="Apache-2.0",
    keywords=["ROS", "SLAM", "EKF", "visual-inertial", "robotics"],
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed"], f"{PACKAGE}.data.report": ["page.css", "page.js"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        # Named in colcon.pkg: whoever sources the workspace has `vislam` on the PATH.
        (f"share/{PACKAGE}/hook", ["resource/hook/executables.dsv"]),
        (f"share/{PACKAGE}/config", sorted(map(str, Path("config").iterdir()))),
        (f"share/{PACKAGE}/launch", sorted(map(str, Path(PACKAGE, "launch").glob("*.launch.py")))),
    ],
    zip_safe=False,
    python_requires=">=3.10",
    # The same dependencies stand in package.xml; test/test_package.py compares the two.
    install_requires=[
        "PyYAML>=6.0",
        "argcomplete>=2.0",
        "matplotlib>=3.6",
        "mcap>=1.5",
        "numba>=0.59",
        "numpy>=1.24",
        "opencv-python-headless>=4.6",
        "rich>=13.3",
        "rosbags>=0.11.9",
        "scipy>=1.10",
        "threadpoolctl>=3.1",
    ],
    extras_require={
        # The ROS 2 wheels. A sourced ROS 2 installation has the same, so it goes without.
        "ros": [
            "ros-jazzy-rclpy[fastrtps]>=7.1",
            "ros-jazzy-common-interfaces>=5.3",
        ],
        "test": [
            "catkin-pkg",
            "evo",
            "hypothesis",
            "lz4",
            "playwright",
            "pytest>=7.4",
            "pytest-cov>=7.0",
            "pytest-timeout",
            "pytest-xdist",
            "zstandard",
        ],
        "colcon": ["colcon-metadata>=0.2", "colcon-ros>=0.5"],
        # Optional: a cluster for sweeps, and a peer to measure against.
        "dask": ["distributed"],
        # GTSAM 4.2, the last for Python 3.10, does not go with numpy 2.
        "peers": ["gtsam>=4.3; python_version >= '3.11'"],
        # Optional: `vislam report` and `vislam view`.
        "report": ["plotly>=6.0"],
        "view": ["rerun-sdk>=0.26; python_version >= '3.11'"],
        # Optional: `make docs`.
        "docs": ["furo>=2024.8", "latex2mathml>=3.77", "myst-parser>=4.0", "sphinx>=8.1"],
        # Optional: tools/fuzz.py.
        "fuzz": ["atheris>=3.0; python_version >= '3.11'"],
        "lint": [
            "mypy",
            "pre-commit",
            "pre-commit-hooks",
            "ruff",
            "scipy-stubs",
            "types-PyYAML",
        ],
    },
    entry_points={
        "console_scripts": [
            "imu_prediction_node = vislam_ros.nodes.imu_prediction_node:main",
            "recorder_node = vislam_ros.nodes.recorder_node:main",
            "slam_node = vislam_ros.nodes.slam_node:main",
            "stereo_tracker_node = vislam_ros.nodes.stereo_tracker_node:main",
            "vislam = vislam_ros.cli.main:main",
        ],
    },
)
