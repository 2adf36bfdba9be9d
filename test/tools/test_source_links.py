# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Links from the documentation to functions, and the tool that keeps their lines right."""

import importlib
import operator
from pathlib import Path

import pytest
from places import REPOSITORY
from source_links import definitions, main, pages, source_links, with_right_lines

MODULE = '''\
"""A module."""


def first() -> None:
    pass


class Second:
    @property
    def third(self):
        pass
'''


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "module.py").write_text(MODULE)
    return tmp_path


def faults(text: str, folder: Path) -> list[str | None]:
    return [link.fault() for link in source_links(text, folder)]


def test_definitions_are_functions_classes_and_methods_with_their_lines(folder: Path) -> None:
    assert definitions(folder / "module.py") == {"first": 4, "Second": 8, "Second.third": 10}


def test_a_right_link_has_no_fault(folder: Path) -> None:
    assert faults("see [`module.Second.third`](module.py#L10).", folder) == [None]


@pytest.mark.parametrize(
    ("link", "fault"),
    [
        ("[`module.first`](module.py#L5)", "is at line 4, not 5"),
        ("[`module.fourth`](module.py#L4)", "does not define it"),
        ("[`other.first`](module.py#L4)", "the link is to module module"),
        ("[`module.first`](gone/module.py#L4)", "there is no file"),
    ],
)
def test_a_wrong_link_is_told(folder: Path, link: str, fault: str) -> None:
    (found,) = faults(link, folder)
    assert fault in str(found)


def test_lines_are_put_right_and_what_is_unknown_is_left_as_it_is(folder: Path) -> None:
    text = "[`module.first`](module.py#L1) and [`module.fourth`](module.py#L1)"
    right = with_right_lines(text, folder)
    assert right == "[`module.first`](module.py#L4) and [`module.fourth`](module.py#L1)"


def test_every_link_of_the_documentation_points_to_its_definition(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([]) == 0, capsys.readouterr().out


def test_every_name_that_the_documentation_links_to_can_be_imported() -> None:
    links = [link for page in pages() for link in source_links(page.read_text(), page.parent)]
    assert links
    for link in links:
        path = link.source.relative_to(REPOSITORY).with_suffix("")
        # The package is imported by its full name, tests and tools by their own.
        parts = path.parts if path.parts[0] == "vislam_ros" else path.parts[1:]
        operator.attrgetter(link.qualname)(importlib.import_module(".".join(parts)))
