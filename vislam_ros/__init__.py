# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""EKF visual-inertial SLAM from stereo feature tracks and IMU twist, replayed live on ROS 2.

Four layers, and an import only ever points down: :mod:`vislam_ros.core` (mathematics),
:mod:`vislam_ros.data` (datasets, bags, results), :mod:`vislam_ros.nodes` (rclpy) and
:mod:`vislam_ros.cli` (the command line).

From Python the names of ``__all__`` are all that is needed, see ``docs/python.md``::

    import vislam_ros as vi

    solution = vi.solve(vi.load_drive("drive.npz"))

Each is imported when it is first asked for.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vislam_ros.core.filters.registry import register_estimator
    from vislam_ros.core.settings import PredictionSettings, SlamSettings
    from vislam_ros.core.slam import Slam
    from vislam_ros.data.datasets.formats import register_dataset
    from vislam_ros.data.drive import Drive
    from vislam_ros.data.evaluation.evaluate import evaluate
    from vislam_ros.data.loading import load_drive
    from vislam_ros.data.simulation.simulate import simulate
    from vislam_ros.data.solving import Solution, solve
    from vislam_ros.data.trajectory import read_tum
    from vislam_ros.errors import VislamError

__version__ = "0.1.0"

__all__ = [
    "Drive",
    "PredictionSettings",
    "Slam",
    "SlamSettings",
    "Solution",
    "VislamError",
    "evaluate",
    "load_drive",
    "read_tum",
    "register_dataset",
    "register_estimator",
    "simulate",
    "solve",
]

_HOMES = {
    "Drive": "data.drive",
    "PredictionSettings": "core.settings",
    "Slam": "core.slam",
    "SlamSettings": "core.settings",
    "Solution": "data.solving",
    "VislamError": "errors",
    "evaluate": "data.evaluation.evaluate",
    "load_drive": "data.loading",
    "read_tum": "data.trajectory",
    "register_dataset": "data.datasets.formats",
    "register_estimator": "core.filters.registry",
    "simulate": "data.simulation.simulate",
    "solve": "data.solving",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
