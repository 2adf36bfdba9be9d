# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The pages say what is so: their links lead somewhere, their commands are the real ones."""

import argparse
import importlib
import re
import shlex
from pathlib import Path

import pytest
from places import REPOSITORY
from source_links import pages

import vislam_ros
from vislam_ros.cli.parser import build_parser

FENCE = re.compile(r"^```(\w*)\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
# Tools with options, and what makes their parsers.
TOOLS = {"tools/bench.py": "bench"}

named_pages = pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)


def without_code(page: Path) -> str:
    return re.sub(r"``.*?``|`[^`\n]*`", "`code`", FENCE.sub("", page.read_text()))


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", FENCE.sub("", page.read_text()), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading).lower().replace(" ", "-") for heading in headings}


def shell_lines(page: Path) -> list[list[str]]:
    """Commands of a page's shell blocks, without their comments and where their output goes."""
    blocks = [block for language, block in FENCE.findall(page.read_text()) if language == "sh"]
    return [
        words
        for block in blocks
        for line in block.replace("\\\n", " ").splitlines()
        if (words := shlex.split(line.partition(" > ")[0], comments=True))
    ]


def inline_commands(page: Path) -> list[list[str]]:
    """Commands between backticks in a page's text; one that an ellipsis cuts off is none."""
    codes = re.findall(r"`([^`]+)`", FENCE.sub("", page.read_text()))
    return [shlex.split(code) for code in codes if "…" not in code and code.count("'") != 1]


def parses(parser: argparse.ArgumentParser, arguments: list[str]) -> bool:
    """Whether a parser takes arguments; --help is taken, too."""
    try:
        parser.parse_args(arguments)
    except SystemExit as ended:
        return not ended.code
    return True


def program(words: list[str]) -> str:
    """Last part of the path of what a command starts."""
    return words[0].rpartition("/")[2] if words else ""


@named_pages
def test_every_link_inside_the_project_leads_somewhere(page: Path) -> None:
    links = [link for link in LINK.findall(without_code(page)) if "://" not in link]
    for link in links:
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        assert REPOSITORY in [target, *target.parents], f"{link} leads out of the project"
        if anchor and target.suffix == ".md":
            assert anchor in anchors(target), link


@named_pages
def test_every_vislam_command_is_one_that_the_parser_takes(page: Path) -> None:
    parser = build_parser()
    (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    for words in shell_lines(page):
        if program(words) == "vislam":
            assert parses(parser, words[1:]), " ".join(words)
    for words in inline_commands(page):
        if program(words) == "vislam" and words[1:] and words[1] != "COMMAND":
            is_a_name = len(words) == 2 and words[1] in commands.choices
            assert is_a_name or parses(parser, words[1:]), " ".join(words)


@named_pages
def test_every_call_of_a_tool_is_one_that_it_takes(page: Path) -> None:
    for words in [*shell_lines(page), *inline_commands(page)]:
        for k, word in enumerate(words):
            if re.fullmatch(r"tools/\w+\.py", word):
                assert (REPOSITORY / word).is_file(), word
                if word in TOOLS and words[k + 1 :]:
                    parser = importlib.import_module(TOOLS[word])._parser()
                    assert parses(parser, words[k + 1 :]), " ".join(words)


@named_pages
def test_every_make_target_is_one_of_the_makefile(page: Path) -> None:
    targets = re.findall(r"^(\w+):.*## ", (REPOSITORY / "Makefile").read_text(), re.MULTILINE)
    for words in [*shell_lines(page), *inline_commands(page)]:
        if len(words) > 1 and words[0] == "make":
            assert words[1] in targets, " ".join(words)


def test_the_readme_uses_from_python_what_there_is() -> None:
    (example,) = (
        block
        for language, block in FENCE.findall((REPOSITORY / "README.md").read_text())
        if language == "python"
    )
    used = set(re.findall(r"\bvi\.(\w+)", example))
    assert used
    assert used <= set(vislam_ros.__all__)


def test_the_readme_is_short() -> None:
    assert len((REPOSITORY / "README.md").read_bytes()) < 12_000
