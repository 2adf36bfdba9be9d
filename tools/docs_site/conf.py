# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the site that Sphinx makes of README, CONTRIBUTING and docs.

The pages are read where they stand, so a link is the same on the site and in the repository.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from docs_site.offline import setup

__all__ = ["setup"]

project = "vislam_ros"
copyright = "the vislam_ros contributors"
root_doc = "README"
include_patterns = ["README.md", "CONTRIBUTING.md", "CHANGELOG.rst", "docs/*.md"]
# Not even looked into.
exclude_patterns = [".*", "build", "install", "log", "results", "test", "tools", "vislam_ros"]

extensions = ["myst_parser"]
myst_enable_extensions = ["dollarmath"]
# The anchors that GitHub gives to headings.
myst_heading_anchors = 4
myst_url_schemes = {"http": None, "https": None, "mailto": None, "source": None}
html_math_renderer = "mathml"

# What commands say is no program.
highlight_language = "none"

html_theme = "furo"
html_title = "vislam_ros"
html_copy_source = False
html_show_sphinx = False
# Summaries would be fetched, which browsers refuse to a page from a file.
html_show_search_summary = False
html_static_path = ["static"]
html_css_files = ["site.css"]
