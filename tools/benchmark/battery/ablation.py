# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The battery once as it is, and once without each mechanism."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmark.battery.measuring import Battery, measure_battery
from benchmark.battery.mechanisms import MECHANISMS
from benchmark.battery.rows import BatteryRow
from benchmark.battery.summary import ALL
from benchmark.battery.trials import TrialSettings


def measure_ablation(
    directory: Path,
    rows: Sequence[BatteryRow],
    settings: TrialSettings,
    *,
    names: Iterable[str] = MECHANISMS,
    seeds: int,
    jobs: int,
    force: bool,
) -> tuple[list[dict[str, Any]], list[str]]:
    """Run the battery with each of these mechanisms switched off.

    Parameters
    ----------
    directory : Path
        Holds a battery for each, in ``as it is`` and in ``without ...``, which a later call goes
        on with.
    rows : sequence of BatteryRow
    settings : TrialSettings
    names : iterable of str
    seeds, jobs, force
        See :func:`benchmark.battery.measuring.measure_battery`.

    Returns
    -------
    ablation : list of dict
        For each mechanism its ``name``, how many rows are ``worse`` than dead reckoning, and by
        the name of each group of rows the geometric mean of the error over that with it; the
        first is the filter as it is.
    notes : list of str
        Rows that are left out, trials that failed.
    """
    as_it_is = directory / "as it is"

    def measured(folder: Path, without: str | None) -> Battery:
        return measure_battery(
            folder,
            rows,
            replace(settings, without=without),
            seeds=seeds,
            jobs=jobs,
            force=force,
            beside=None if without is None else as_it_is,
        )

    whole = measured(as_it_is, None)
    ablation, notes = [_line("nothing", whole)], list(whole.notes)
    for name in names:
        battery = measured(directory / f"without {name}", name)
        ablation.append(_line(name, battery))
        notes += [f"without {name}: {note}" for note in battery.notes if note not in notes]
    return ablation, notes


def _line(name: str, battery: Battery) -> dict[str, Any]:
    by_group = {group["name"]: group["to_beside"] for group in battery.groups}
    worse = next(group["worse"] for group in battery.groups if group["name"] == ALL)
    return {"name": name, "worse": worse} | by_group
