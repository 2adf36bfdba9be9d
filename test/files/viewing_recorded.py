# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of the viewer, read back."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np


class Recorded:
    """What a recording holds: rows by entity, component and time."""

    def __init__(self, path: Path):
        chunks = importlib.import_module("rerun.chunk")
        self.columns: dict[tuple[str, str], list[Any]] = {}
        self.seconds: dict[str, list[float]] = {}
        for chunk in chunks.RrdReader(path).stream():
            batch = chunk.to_record_batch()
            for name in batch.schema.names:
                rows = batch.column(name)
                if name == "time":
                    nanoseconds = rows.cast("int64").to_pylist()
                    seconds = self.seconds.setdefault(chunk.entity_path, [])
                    seconds.extend(each * 1e-9 for each in nanoseconds)
                else:
                    held = self.columns.setdefault((chunk.entity_path, name), [])
                    held.extend(rows.to_pylist())

    def __getitem__(self, key: tuple[str, str]) -> np.ndarray:
        return np.array(self.columns[key])

    @property
    def entities(self) -> set[str]:
        return {path for path, _ in self.columns}
