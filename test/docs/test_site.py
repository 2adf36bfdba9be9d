# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The site of the documentation: whole, without a broken link, and without the network."""

import re
import subprocess
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from places import REPOSITORY
from source_links import pages, source_links

GENERATOR = ("sphinx", "furo", "myst_parser", "latex2mathml")
# Elements that have a browser fetch something, and the attribute that says from where.
FETCHED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}
TEX = re.compile(r"\$\$?([^$]+)\$\$?")
CODE = re.compile(r"^```.*?^```|`[^`\n]+`", re.MULTILINE | re.DOTALL)


class Page(HTMLParser):
    """What a page fetches, links to, and can be linked to."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note an element."""
        values = {name: value for name, value in attrs if value is not None}
        self.anchors.add(values.get("id", ""))
        if tag in FETCHED and FETCHED[tag] in values:
            self.fetched.append(values[FETCHED[tag]])
        if tag == "a" and "href" in values:
            self.links.append(values["href"])


@cache
def read(path: Path) -> Page:
    return Page(path.read_text())


def is_elsewhere(link: str) -> bool:
    return bool(re.match(r"(\w+:)?//|mailto:", link))


def built(page: Path, site: Path) -> Path:
    """Page of the site that a page of the repository became."""
    return site / page.relative_to(REPOSITORY).with_suffix(".html")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for module in GENERATOR:
        pytest.importorskip(module, reason="the extra docs is not installed")
    folder = tmp_path_factory.mktemp("site")
    command = ["sphinx", "-E", "-W", "--keep-going", "-q", "-c", "tools/docs_site", ".", folder]
    ended = subprocess.run(
        [sys.executable, "-m", *map(str, command)],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    return folder


def test_every_page_is_there_and_the_site_begins_with_the_readme(site: Path) -> None:
    assert len(pages()) > 20
    assert all(built(page, site).is_file() for page in pages())
    assert "url=README.html" in (site / "index.html").read_text()


def test_every_page_of_docs_is_in_the_side_bar(site: Path) -> None:
    listed = {link.partition("#")[0] for link in read(site / "README.html").links}
    names = {built(page, site).relative_to(site).as_posix() for page in pages()}
    assert names - {"README.html"} <= listed


def test_nothing_is_fetched_from_the_network(site: Path) -> None:
    for path in site.rglob("*.html"):
        assert not [uri for uri in read(path).fetched if is_elsewhere(uri)], path
    for path in site.rglob("*.css"):
        fetched = re.findall(r"@import[^;]*|url\([^)]*\)", path.read_text())
        assert not [uri for uri in fetched if "//" in uri.partition("data:")[0]], path


def test_every_link_inside_the_site_leads_somewhere(site: Path) -> None:
    followed = 0
    for path in site.rglob("*.html"):
        for link in read(path).links + read(path).fetched:
            if is_elsewhere(link):
                continue
            name, _, anchor = unquote(link).partition("#")
            target = (path.parent / name.partition("?")[0]).resolve() if name else path
            assert target.is_file(), f"{path}: {link}"
            if anchor:
                assert anchor in read(target).anchors, f"{path}: {link}"
            followed += 1
    assert followed > 1000


def test_links_to_code_show_the_definition(site: Path) -> None:
    page = REPOSITORY / "docs" / "equations.md"
    links = list(source_links(page.read_text(), page.parent))
    for link in links:
        shown = site / "source" / f"{link.source.relative_to(REPOSITORY)}.html"
        (line,) = re.findall(rf'<span id="L-{link.line}">(.*)', shown.read_text())
        assert link.qualname.rpartition(".")[2] in re.sub("<[^>]*>", "", line), link
    hrefs = {href for href in read(built(page, site)).links if href.startswith("../source/")}
    assert len(hrefs) >= len({(link.source, link.line) for link in links})


def test_every_equation_is_mathml(site: Path) -> None:
    for page in pages():
        equations = TEX.findall(CODE.sub("", page.read_text()))
        html = built(page, site).read_text()
        rendered = re.findall(r"<math .*?</math>", html, re.DOTALL)
        assert len(rendered) == len(equations), page
        assert not [maths for maths in rendered if "\\" in maths or "merror" in maths], page
    assert "<math " in built(REPOSITORY / "docs" / "equations.md", site).read_text()


@pytest.mark.parametrize("size", [(1280, 900), (390, 844)], ids=["wide", "narrow"])
def test_a_browser_shows_and_searches_it_from_the_file(
    site: Path, browser: Any, size: tuple[int, int]
) -> None:
    page = browser.new_context(viewport={"width": size[0], "height": size[1]}).new_page()
    page.set_default_timeout(60_000)
    asked: list[str] = []
    complaints: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda said: complaints.extend([said.text] * (said.type == "error")))
    for name in ("README.html", "docs/equations.html", "docs/topics.html"):
        page.goto((site / name).as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0], name
    page.goto((site / "search.html").as_uri() + "?q=misprint")
    page.wait_for_selector("#search-results a[href^='docs/equations.html']")
    page.context.close()
    assert not complaints
    assert not [url for url in asked if not url.startswith(("file:", "data:"))]
