# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the site does without the network: equations as MathML, and the code that pages link to.

Sphinx would have a browser fetch MathJax, and has no pages for source files.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import get_lexer_for_filename
from pygments.lexers.special import TextLexer
from pygments.util import ClassNotFound
from sphinx.application import Sphinx

#: The pages of the side bar, under their captions.
NAVIGATION = {
    "Begin": ("docs/tutorial_student", "docs/tutorial_robot", "docs/troubles"),
    "Use": (
        *("docs/inspect", "docs/images", "docs/evaluation", "docs/pictures", "docs/results"),
        *("docs/verdict", "docs/simulation", "docs/python"),
    ),
    "Reference": (
        *("docs/topics", "docs/parameters", "docs/conventions", "docs/data_traps"),
        *("docs/estimators", "docs/equations", "docs/front_end", "docs/constants"),
    ),
    "Measured": ("docs/accuracy", "docs/speed", "docs/consistency", "docs/reliability"),
    "Project": ("CONTRIBUTING", "CHANGELOG"),
}

_SCHEME = "source:"
_LINK = re.compile(r"(?<=\]\()(?P<path>[\w./-]+)(?:#L(?P<line>\d+))?(?=\))")
_SHOWN_BY_SPHINX = {".md", ".rst", ".png", ".svg", ".jpg", ".gif"}
_TO_THE_START = '<!doctype html><meta http-equiv="refresh" content="0; url=README.html">\n'


def setup(app: Sphinx) -> dict[str, Any]:
    """Register all of it with Sphinx."""
    app.add_html_math_renderer("mathml", (_inline_math, None), (_displayed_math, None))
    app.connect("source-read", _read)
    app.connect("doctree-resolved", _lead_to_source_pages)
    app.connect("html-collect-pages", _source_pages)
    app.connect("build-finished", _begin_at_the_readme)
    return {"parallel_read_safe": False, "parallel_write_safe": False}


def _inline_math(translator: Any, node: nodes.math) -> None:
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _displayed_math(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>')
    raise nodes.SkipNode


def _read(app: Sphinx, name: str, content: list[str]) -> None:
    """Mark links to source files, and give the first page the side bar's contents."""
    folder = Path(app.env.doc2path(name)).parent

    def marked(link: re.Match[str]) -> str:
        target = (folder / link["path"]).resolve()
        if not target.is_file() or target.suffix in _SHOWN_BY_SPHINX:
            return link[0]
        path = target.relative_to(app.srcdir).as_posix()
        return f"{_SCHEME}{path}" + (f"#L-{link['line']}" if link["line"] else "")

    content[0] = _LINK.sub(marked, content[0])
    if name == app.config.root_doc:
        for caption, pages in NAVIGATION.items():
            entries = "\n".join(pages)
            content[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{entries}\n```\n"


def _lead_to_source_pages(app: Sphinx, doctree: nodes.document, name: str) -> None:
    """Have marked links lead to the pages of the source files, and remember which are wanted."""
    for link in doctree.findall(nodes.reference):
        uri = link.get("refuri", "")
        if uri.startswith(_SCHEME):
            path, _, line = uri.removeprefix(_SCHEME).partition("#")
            wanted = app.env.__dict__.setdefault("linked_sources", set())
            wanted.add(path)
            page = app.builder.get_relative_uri(name, f"source/{path}")
            link["refuri"] = f"{page}#{line}" if line else page


def _source_pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Make a page of each source file that a page links to."""
    formatter: HtmlFormatter[str] = HtmlFormatter(linenos="inline", linespans="L")
    for path in sorted(getattr(app.env, "linked_sources", ())):
        text = (Path(app.srcdir) / path).read_text()
        try:
            lexer = get_lexer_for_filename(path)
        except ClassNotFound:
            lexer = TextLexer()
        body = f"<h1><code>{path}</code></h1>{highlight(text, lexer, formatter)}"
        yield f"source/{path}", {"title": path, "body": body, "parents": []}, "page.html"


def _begin_at_the_readme(app: Sphinx, fault: Exception | None) -> None:
    if fault is None:
        (Path(app.outdir) / "index.html").write_text(_TO_THE_START)
