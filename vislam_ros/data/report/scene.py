# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The path and the map in three dimensions, as plotly's JSON has them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.evaluation.evaluate import length_words
from vislam_ros.data.evaluation.laid_paths import LaidPaths
from vislam_ros.data.pictures import palette
from vislam_ros.data.results.reader import Results

Array = NDArray[np.float64]

#: Of a path; a longer one is drawn with so many of its poses.
MOST_POSES = 20_000
#: Of the map near the path; of a larger one so many are drawn, evenly along the drive.
MOST_LANDMARKS = 20_000

# Around the paths landmarks are drawn, as a share of their extent: the farthest hide all else.
_SURROUNDINGS = 0.15
_LEAST_SURROUNDINGS = 20.0  # metres
_STYLES = {
    "estimate": (palette.ESTIMATE, 6, "solid"),
    "smoothed": (palette.SMOOTHED, 5, "solid"),
    "dead reckoning": (palette.DEAD_RECKONING, 4, "solid"),
    "reference": (palette.REFERENCE, 3, "dash"),
}


def evenly(count: int, most: int) -> NDArray[np.int64]:
    """Rows of a table, all or so many of them, the first and the last among them."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, most).round().astype(np.int64))


def drawn_landmarks(results: Results, laid: LaidPaths) -> tuple[NDArray[np.int64], Array]:
    """Rows (n,) of the landmarks that are drawn, and the deviations (M,) of all, metres.

    The deviation is the root of the largest eigenvalue of a landmark's covariance: how far it may
    lie from where it is, along the axis where that is farthest.
    """
    landmarks = results.landmarks
    if landmarks is None or not len(landmarks):
        return np.empty(0, dtype=np.int64), np.empty(0)
    std = np.sqrt(np.maximum(np.linalg.eigvalsh(landmarks.covariances)[:, -1], 0.0))
    corners = np.concatenate([path.positions for path in laid.paths])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = max(_SURROUNDINGS * float(np.max(high - low)), _LEAST_SURROUNDINGS)
    near = (landmarks.positions > low - margin) & (landmarks.positions < high + margin)
    rows = np.flatnonzero(near.all(axis=1))
    # They are in the order in which they came: every n-th of them is spread over the drive.
    return rows[evenly(len(rows), MOST_LANDMARKS)], std


def scene_figure(results: Results, laid: LaidPaths) -> dict[str, Any]:
    """Data and layout of the scene.

    The last trace is one point, which the page moves to the moment that is pointed at; the first
    one is the estimate, whose custom data are its seconds.
    """
    origin = int(results.trajectory.stamps[0])
    traces: list[dict[str, Any]] = []
    for path in laid.paths:
        colour, width, dash = _STYLES[path.name]
        rows = evenly(len(path.stamps), MOST_POSES)
        told = "" if path.rmse is None else f", {length_words(path.rmse)}"
        traces.append(
            {
                "type": "scatter3d",
                "mode": "lines",
                "name": f"{path.name}{told}",
                "line": {"color": colour, "width": width, "dash": dash},
                "customdata": (path.stamps[rows] - origin) * 1e-9,
                "hovertemplate": "%{customdata:.2f} s<br>%{x:.2f}, %{y:.2f}, %{z:.2f} m",
                **_coordinates(path.positions[rows]),
            }
        )
    traces.extend(_landmark_traces(results, laid))
    first = results.trajectory.positions[:1]
    for name, place, colour in (
        ("start", first, palette.START),
        ("end", results.trajectory.positions[-1:], palette.END),
        ("now", first, "#000000"),
    ):
        traces.append(
            {
                "type": "scatter3d",
                "mode": "markers",
                "name": name,
                "marker": {"color": colour, "size": 6 if name != "now" else 8},
                "hoverinfo": "name",
                **({"visible": False} if name == "now" else {}),
                **_coordinates(place),
            }
        )
    plain = {"showbackground": False, "gridcolor": "#e6e6e6", "zerolinecolor": "#cccccc"}
    axes = {f"{axis}axis": {"title": {"text": f"{axis} [m]"}, **plain} for axis in "xyz"}
    layout = {
        "scene": {
            **axes,
            "aspectmode": "data",
            # A map, tilted a little; without perspective, so that lengths can be compared.
            "camera": {
                "eye": {"x": 0.0, "y": -1.0, "z": 2.2},
                "projection": {"type": "orthographic"},
            },
        },
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "legend": {"orientation": "h", "yanchor": "top", "y": 0.0, "itemsizing": "constant"},
        "uirevision": "kept",
    }
    return {"data": traces, "layout": layout}


def _landmark_traces(results: Results, laid: LaidPaths) -> list[dict[str, Any]]:
    rows, std = drawn_landmarks(results, laid)
    if results.landmarks is None or not len(rows):
        return []
    # A landmark is known to a centimetre or to a hundred metres: the logarithm shows both.
    level = np.log10(np.maximum(std[rows], 1e-4)).astype(np.float32)
    low, high = np.percentile(level, [2, 98]).tolist()
    ticks = np.arange(np.floor(low), np.ceil(high) + 1).tolist()
    return [
        {
            "type": "scatter3d",
            "mode": "markers",
            "name": "landmarks",
            "opacity": 0.45,
            "marker": {
                "size": 1,
                "line": {"width": 0},
                "color": level,
                # Pale where little is known, so that the path is seen through the map.
                "colorscale": [[0.0, "#08306b"], [0.5, "#6b8fb3"], [1.0, "#d9e2ec"]],
                "cmin": low,
                "cmax": max(high, low + 0.1),
                "colorbar": {
                    "title": {"text": f"landmark {palette.SIGMA} [m]", "side": "right"},
                    "tickvals": ticks,
                    "ticktext": [f"{10.0**tick:g}" for tick in ticks],
                    "thickness": 10,
                    "len": 0.6,
                },
            },
            "customdata": results.landmarks.ids[rows].astype(np.int64),
            "hovertemplate": "landmark %{customdata}<br>%{x:.2f}, %{y:.2f}, %{z:.2f} m",
            **_coordinates(results.landmarks.positions[rows]),
        }
    ]


def _coordinates(positions: Array) -> dict[str, NDArray[np.float32]]:
    return dict(zip("xyz", positions.T.astype(np.float32), strict=True))
