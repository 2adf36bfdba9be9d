# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The version that is released is the same in the package, the changelog and the citation."""

import datetime
import re
from typing import Any

import pytest
import yaml
from catkin_pkg.changelog import get_changelog_from_path
from places import REPOSITORY

import vislam_ros

CITATION = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text())


@pytest.fixture
def sections() -> list[tuple[str, Any, Any]]:
    """Version, date and content of each section of the changelog, the newest first."""
    return list(get_changelog_from_path(str(REPOSITORY)).foreach_version())


def test_the_citation_has_what_its_format_asks_for() -> None:
    assert CITATION["cff-version"] == "1.2.0"
    assert CITATION["message"]
    assert CITATION["title"].startswith("vislam_ros")
    assert all(author["name"] for author in CITATION["authors"])
    assert re.fullmatch(r"\d+\.\d+\.\d+", CITATION["version"])
    assert isinstance(CITATION["date-released"], datetime.date)


# catkin_pkg is older than its docutils.
@pytest.mark.filterwarnings("ignore:nodes.Node.traverse")
def test_the_latest_release_of_the_changelog_is_the_packages_and_the_citations(
    sections: list[tuple[str, Any, Any]],
) -> None:
    releases = [(version, date) for version, date, _ in sections if version != "Forthcoming"]
    version, date = releases[0]
    assert version == vislam_ros.__version__ == CITATION["version"]
    assert date.date() == CITATION["date-released"]


@pytest.mark.filterwarnings("ignore:nodes.Node.traverse")
def test_every_release_tells_its_users_what_is_new(sections: list[tuple[str, Any, Any]]) -> None:
    for version, _, content in sections:
        assert content, version
