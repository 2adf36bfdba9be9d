# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables of topics, parameters, estimators, commands and rooms are those of the code."""

import argparse
import ast
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from places import REPOSITORY

from vislam_ros.cli.parser import build_parser
from vislam_ros.core.filters.registry import estimator_named, estimator_names
from vislam_ros.core.tracking.refusals import Refusal
from vislam_ros.data.bags import layout
from vislam_ros.data.files.parameter_file import read_parameters

README = REPOSITORY / "README.md"
DOCS = REPOSITORY / "docs"


def table(page: Path, first_heading: str) -> list[list[str]]:
    """Rows of the table whose first heading is this one, as lists of cells."""
    text = page.read_text()
    block = re.search(rf"^\| {first_heading} \|.*\n\|[-|]+\|\n((?:\|.*\n)+)", text, re.MULTILINE)
    assert block, first_heading
    return [[cell.strip() for cell in row.split("|")[1:-1]] for row in block[1].splitlines()]


def names(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def recommended() -> dict[str, Any]:
    """Values of all parameters in the recommended file, which are the defaults."""
    nodes = read_parameters(REPOSITORY / "config" / "ekf.yaml").values()
    return {name: value for parameters in nodes for name, value in parameters.items()}


def strings_of_the_package() -> set[str]:
    return {
        node.value
        for path in (REPOSITORY / "vislam_ros").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }


def texts_of_the_package() -> list[str]:
    """All texts that the code can say, with an ellipsis for each value in them."""

    def text(node: ast.AST) -> str:
        if isinstance(node, ast.JoinedStr):
            return "".join(text(part) for part in node.values)
        return str(node.value) if isinstance(node, ast.Constant) else "…"

    return [
        text(node)
        for path in (REPOSITORY / "vislam_ros").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.JoinedStr)
        or (isinstance(node, ast.Constant) and isinstance(node.value, str))
    ]


def said_by(quoted: str) -> re.Pattern[str]:
    """Texts that say what a page quotes, whatever stands in place of an ellipsis."""
    parts = [re.escape(part.strip()) for part in re.split("…", quoted) if len(part.strip()) > 1]
    return re.compile(".*".join(parts))


def test_every_message_that_is_explained_is_one_of_the_code() -> None:
    texts = texts_of_the_package()
    rows = table(DOCS / "troubles.md", "it says")
    assert len(rows) > 15
    for row in rows:
        (quoted,) = names(row[0])
        assert any(said_by(quoted).search(text) for text in texts), quoted


def test_every_service_is_documented_and_every_documented_one_exists() -> None:
    nodes = REPOSITORY / "vislam_ros" / "nodes"
    declared = {
        f"{path.stem}/{name}"
        for path in nodes.rglob("*.py")
        for name in re.findall(r'serve\("~/(\w+)"', path.read_text())
    }
    (commands,) = re.findall(r"for command in \((.*)\):", (nodes / "player/player.py").read_text())
    declared |= {f"player/{name}" for name in re.findall(r"self\.(\w+)", commands)}
    documented = [name for row in table(DOCS / "topics.md", "service") for name in names(row[0])]
    assert sorted(documented) == sorted(declared)
    # None is offered in another way.
    offered = [path.name for path in nodes.rglob("*.py") if "create_service(" in path.read_text()]
    assert sorted(offered) == ["diagnostics.py", "player.py"]


def test_every_declared_topic_is_documented_with_its_type() -> None:
    documented = {
        row[0].strip("`/"): row[1].strip("`") for row in table(DOCS / "topics.md", "topic")
    }
    declared = {
        topic.name.strip("/"): topic.msgtype.replace("/msg/", "/")
        for topic in vars(layout).values()
        if isinstance(topic, layout.Topic)
    }
    assert declared.items() <= documented.items()


def test_every_reason_to_refuse_a_message_is_documented_as_it_is_declared() -> None:
    declared = [[f"`{refusal.word}`", refusal.text] for refusal in Refusal]
    assert table(DOCS / "topics.md", "reason") == declared


def test_the_last_four_reasons_are_the_faults_of_a_run_as_the_page_says() -> None:
    assert [refusal.is_of_data for refusal in Refusal] == (len(Refusal) - 4) * [True] + 4 * [False]


@pytest.mark.parametrize("page", [README, DOCS / "topics.md"], ids=lambda page: page.name)
def test_every_documented_topic_is_named_in_the_code(page: Path) -> None:
    named = strings_of_the_package()
    for row in table(page, "topic"):
        for topic in names(row[0]):
            assert topic in named or topic.strip("/") in named, topic


def test_every_documented_parameter_has_the_value_that_the_page_says() -> None:
    values = recommended()
    for row in table(DOCS / "parameters.md", "parameter"):
        for name, value in zip(names(row[0]), row[1].split(", "), strict=True):
            first = values[name][0] if isinstance(values[name], list) else values[name]
            assert yaml.safe_load(value.split()[0].strip("`")) == first, name


def test_every_parameter_that_a_situation_asks_for_exists() -> None:
    declared = recommended().keys()
    for row in table(DOCS / "parameters.md", "you have"):
        settings = [name for name in names(row[1]) if not name.startswith("--")]
        assert {setting.partition(":")[0] for setting in settings} <= declared


def test_the_table_of_estimators_is_that_of_the_package() -> None:
    # Others may be registered by then.
    makers = {name: estimator_named(name).make.__module__ for name in estimator_names()}
    own = [name for name, module in makers.items() if module.startswith("vislam_ros.")]
    assert [names(row[0])[0] for row in table(DOCS / "estimators.md", "value")] == own


def test_the_table_of_commands_is_that_of_the_parser() -> None:
    parser = build_parser()
    (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    documented = {names(row[0])[0].split()[1] for row in table(README, "command")}
    assert documented == set(commands.choices)


def test_the_table_of_rooms_is_that_of_the_folders() -> None:
    documented = [names(row[0])[0] for row in table(REPOSITORY / "CONTRIBUTING.md", "room")]
    folders = {
        str(path.parent.relative_to(REPOSITORY))
        for root in ("vislam_ros", "tools")
        for path in (REPOSITORY / root).rglob("*.py")
    }
    assert sorted(documented) == sorted(folders - {"vislam_ros"})
