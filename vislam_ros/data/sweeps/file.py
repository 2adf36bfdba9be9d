# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sweep described by a YAML file.

.. code-block:: yaml

    data: drive.npz              # a dataset or a bag; or else simulate, below
    reference: truth.tum         # optional; else the ground truth that the drive may hold
    params: ekf.yaml             # optional; what is not swept
    grid:
      slam_node.chi2_gate: [9, 16.27, 25]
      slam_node.pixel_variance: [[1, 1, 1, 1], [9, 9, 9, 9]]
      slam_node.track_continuity: true       # a single value is set and not swept
    seeds: 5                     # 0 to 4; or a list of seeds
    simulate:                    # a drive for each seed, with these settings of vislam simulate
      steps: 300
      frozen_share: 0.1

Paths are relative to the file.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vislam_ros.data.files.parameter_file import read_yaml
from vislam_ros.errors import VislamError

_PATHS = ("data", "reference", "params")
_KEYS = (*_PATHS, "grid", "seeds", "simulate")


@dataclass(frozen=True)
class SweepFile:
    """What a file, or the command line in its place, says; None or empty where it is silent."""

    data: Path | None = None
    reference: Path | None = None
    params: Path | None = None
    grid: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    seeds: tuple[int, ...] | None = None
    simulate: Mapping[str, Any] | None = None


def read_sweep_file(path: Path) -> SweepFile:
    """Read a sweep's description.

    Raises
    ------
    VislamError
        Naming the file, the key and what it must hold.
    """
    content = read_yaml(path, "this sweep")
    if not isinstance(content, dict):
        raise VislamError(f"{path}: not a sweep: it must hold a mapping of {', '.join(_KEYS)}")
    if unknown := [str(key) for key in content if key not in _KEYS]:
        raise VislamError(
            f"{path}: {', '.join(unknown)}: no such key; there are {', '.join(_KEYS)}"
        )
    paths: dict[str, Path] = {}
    for key in _PATHS:
        if (text := content.get(key)) is None:
            continue
        if not isinstance(text, str):
            raise VislamError(f"{path}: {key}: {text!r} is not a path")
        paths[key] = path.parent / Path(text).expanduser()
    grid, simulate = content.get("grid"), content.get("simulate")
    for key, mapping in (("grid", grid), ("simulate", simulate)):
        if mapping is not None and not isinstance(mapping, dict):
            raise VislamError(f"{path}: {key}: {mapping!r} is not a mapping of names to values")
    if "simulate" in content and simulate is None:
        simulate = {}
    return SweepFile(
        **paths,
        grid={str(name): swept_values(values) for name, values in (grid or {}).items()},
        seeds=_seeds(path, content.get("seeds")),
        simulate=simulate,
    )


def swept_values(values: Any) -> tuple[Any, ...]:
    """Different values in their order; one that is no list stands for itself."""
    listed = [_hashable(value) for value in values] if isinstance(values, list) else [values]
    # 1 and 1.0 are equal and give equal runs; 1 and true are equal and do not.
    return tuple({(isinstance(value, bool), value): value for value in listed}.values())


def _hashable(value: Any) -> Any:
    return tuple(_hashable(item) for item in value) if isinstance(value, list) else value


def _seeds(path: Path, seeds: Any) -> tuple[int, ...] | None:
    if seeds is None:
        return None
    listed = list(range(seeds)) if isinstance(seeds, int) else seeds
    if (
        isinstance(seeds, bool)
        or not isinstance(listed, list)
        or not listed
        or not all(type(seed) is int and seed >= 0 for seed in listed)
    ):
        raise VislamError(f"{path}: seeds: {seeds!r} is neither a number of seeds nor a list")
    return tuple(dict.fromkeys(listed))
