# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The machine and the libraries that a measurement was made with."""

import os
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import threadpoolctl

import vislam_ros


def describe_machine() -> dict[str, Any]:
    """Processor, cores, load, versions and the BLAS libraries with their threads as they are."""
    return {
        "cpu": _cpu_model(),
        "cores": os.cpu_count(),
        "usable_cores": len(os.sched_getaffinity(0)),
        "load_1min": os.getloadavg()[0],
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "gtsam": _version("gtsam"),
        "vislam_ros": vislam_ros.__version__,
        "blas": sorted(
            f"{library['internal_api']} {library['version']} ({library['architecture']}, "
            f"{library['num_threads']} threads) of {Path(library['filepath']).parent.name}"
            for library in threadpoolctl.threadpool_info()
            if library["user_api"] == "blas"
        ),
    }


def _cpu_model() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor()


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
