# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The page of the report's equations: every number once, every function where it says."""

import re

from places import REPOSITORY
from source_links import source_links

PAGE = REPOSITORY / "docs" / "equations.md"
REPORTED = list(range(1, 74))
# With these the report must be read otherwise than it is printed.
MISPRINTED = {11, 13, 20, 23, 36, 50, 52, 57, 64, 66, 67, 70}


def rows() -> list[tuple[int, str]]:
    """Number and text of each row of the tables of equations."""
    found = re.findall(r"^\| \((\d+)\) \|(.*)$", PAGE.read_text(), flags=re.MULTILINE)
    return [(int(number), text) for number, text in found]


def test_each_equation_of_the_report_stands_there_once_and_in_order() -> None:
    assert [number for number, _ in rows()] == REPORTED


def test_each_equation_has_a_function_that_computes_it() -> None:
    for number, text in rows():
        computed_by = text.split("|")[1]
        assert list(source_links(computed_by, PAGE.parent)), number


def test_each_known_misprint_says_what_is_right() -> None:
    said = {number for number, text in rows() if "**misprint**: " in text}
    assert said >= MISPRINTED


def test_each_section_of_equations_holds_those_that_its_heading_names() -> None:
    sections = re.split(r"^## ", PAGE.read_text(), flags=re.MULTILINE)
    named = [
        (range(int(first), int(last) + 1), section)
        for section in sections
        for first, last in re.findall(r"^[IV]+\.?[A-D]? .*\((\d+)\)-\((\d+)\)\n", section)
    ]
    assert sum(len(numbers) for numbers, _ in named) == len(REPORTED)
    for numbers, section in named:
        assert re.findall(r"^\| \((\d+)\) \|", section, flags=re.MULTILINE) == list(
            map(str, numbers)
        )
