# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a filter estimates for the whole drive, as people read it."""

from collections.abc import Iterable, Mapping
from itertools import zip_longest

from vislam_ros.core.columns import Quantity


def estimate_rows(
    estimates: Mapping[str, float | None], quantities: Iterable[Quantity]
) -> dict[str, str]:
    """Last values with their standard deviations, by the quantity's name and unit.

    Parameters
    ----------
    estimates : mapping of str to float or None
        By column, as ``summary.json`` has them.
    quantities : iterable of Quantity
        In the order of the rows; those that are not known have none.
    """
    rows = {}
    for quantity in quantities:
        texts = []
        for name, std_name in zip_longest(quantity.names, quantity.std_names):
            value, std = estimates.get(name), estimates.get(std_name)
            if value is not None:
                texts.append(f"{value:.3g}" if std is None else f"{value:.3g} ± {std:.2g}")
        if texts:
            rows[quantity.label] = ", ".join(texts)
    return rows
