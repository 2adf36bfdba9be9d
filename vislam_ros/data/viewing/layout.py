# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How the viewer arranges what is logged."""

from collections.abc import Sequence
from typing import Any

from vislam_ros.data.pictures.charts import Chart
from vislam_ros.data.viewing.frames import PATH
from vislam_ros.data.viewing.stream import Stream

# More would be too low to read; the others are there to be opened.
_SHOWN = ("landmarks", "nis", "step_ms", "position_std", "gyro_bias")


def send_layout(stream: Stream, charts: Sequence[Chart], *, with_frames: bool) -> None:
    """World and camera on the left, charts on the right: the first ones, and all behind a tab."""
    from rerun import blueprint

    def views(shown: Sequence[Chart]) -> list[Any]:
        return [
            blueprint.TimeSeriesView(origin=f"series/{chart.key}", name=chart.title)
            for chart in shown
        ]

    world = blueprint.Spatial3DView(origin="world", name="path and map")
    camera = blueprint.Spatial2DView(origin=PATH, name="left image and tracks")
    left = blueprint.Vertical(world, camera, row_shares=[3, 2]) if with_frames else world
    first = [chart for chart in charts if chart.key in _SHOWN]
    errors = [chart for chart in charts if chart.key.startswith(("error_", "nees"))]
    others = [chart for chart in charts if chart not in (*first, *errors)]
    tabs = [
        blueprint.Vertical(*views(group), name=name)
        for name, group in (("steps", first), ("errors", errors), ("estimates", others))
        if group
    ]
    parts = [left, blueprint.Tabs(*tabs)] if tabs else [left]
    stream.send_blueprint(
        blueprint.Blueprint(
            blueprint.Horizontal(*parts, column_shares=[3, 2][: len(parts)]),
            collapse_panels=True,
        )
    )
