"""Sphinx configuration."""

import pieper

project = "Pieper"
author = "The Pieper authors"
copyright = f"2026, {author}"
version = release = pieper.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx-mathjax-offline",  # formulas without a request to anybody's server
]
templates_path = ["_templates"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"Pieper {version}"

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

# a link to what is not there is a warning; types are prose here ("(..., 4, 4) array") and no links
nitpicky = True
nitpick_ignore_regex = [("py:(class|obj)", ".*")]

# attributes of the same name in several results are told apart by their class
suppress_warnings = ["ref.python"]

autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
