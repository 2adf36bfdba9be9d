#!/usr/bin/env python3
# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Keep the links of the documentation to functions and classes right.

A page links to code as [`joint.JointFilter.step`](../vislam_ros/core/filters/joint.py#L87): the
module's name and the name inside it, then the file and the line of the definition. Lines move with
every change; names do not.

tools/source_links.py             name what is wrong
tools/source_links.py --write     write the right lines
"""

import argparse
import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
PAGES = (REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md", REPOSITORY / "docs")

_LINK = re.compile(r"\[`(?P<name>\w+(?:\.\w+)+)`\]\((?P<path>[\w./]+\.py)#L(?P<line>\d+)\)")


@dataclass(frozen=True)
class SourceLink:
    """A link of a page to a definition.

    Attributes
    ----------
    name : str
        ``module.function`` or ``module.Class.method``.
    source : Path
        The file that it points to.
    line : int
        The line that it points to.
    """

    name: str
    source: Path
    line: int

    @property
    def qualname(self) -> str:
        """Name inside the module."""
        return self.name.partition(".")[2]

    def fault(self) -> str | None:
        """Say what is wrong with the link, or None."""
        if not self.source.is_file():
            return f"{self.name}: there is no file {self.source}"
        if self.source.stem != self.name.partition(".")[0]:
            return f"{self.name}: the link is to module {self.source.stem}"
        right = definitions(self.source).get(self.qualname)
        if right is None:
            return f"{self.name}: {self.source.name} does not define it"
        return None if right == self.line else f"{self.name}: is at line {right}, not {self.line}"


def definitions(source: Path) -> dict[str, int]:
    """Lines of all functions, classes and methods of a module, by their names inside it."""
    lines: dict[str, int] = {}

    def add(nodes: list[ast.stmt], prefix: str) -> None:
        for node in nodes:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                lines[prefix + node.name] = node.lineno
            if isinstance(node, ast.ClassDef):
                add(node.body, f"{prefix}{node.name}.")

    add(ast.parse(source.read_text()).body, "")
    return lines


def source_links(text: str, folder: Path) -> Iterator[SourceLink]:
    """Links to definitions in a page's text; the page stands in a folder."""
    for match in _LINK.finditer(text):
        source = (folder / match["path"]).resolve()
        yield SourceLink(match["name"], source, int(match["line"]))


def with_right_lines(text: str, folder: Path) -> str:
    """Text of a page with the line of each link put right, where its name is known."""

    def right(match: re.Match[str]) -> str:
        (link,) = source_links(match[0], folder)
        lines = definitions(link.source) if link.source.is_file() else {}
        line = lines.get(link.qualname, link.line)
        return f"[`{match['name']}`]({match['path']}#L{line})"

    return _LINK.sub(right, text)


def pages() -> list[Path]:
    """All pages that may link to code."""
    found = [[path] if path.is_file() else sorted(path.rglob("*.md")) for path in PAGES]
    return [page for part in found for page in part]


def main(argv: list[str] | None = None) -> int:
    """Check or write; return 1 where something is wrong and stays so."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--write", action="store_true", help="write the right lines")
    write = parser.parse_args(argv).write
    faults = []
    for page in pages():
        text = page.read_text()
        if write and text != (right := with_right_lines(text, page.parent)):
            page.write_text(right)
            text = right
        links = source_links(text, page.parent)
        faults += [f"{page.relative_to(REPOSITORY)}: {f}" for link in links if (f := link.fault())]
    print("\n".join(faults), end="\n" if faults else "")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
