"""Sphinx configuration."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from docutils import nodes
from sphinx import addnodes
from sphinx.util.inspect import TypeAliasForwardRef

import pieper

if TYPE_CHECKING:
    from sphinx.application import Sphinx

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

# `name` in a docstring is a link where there is something of that name, and code where not
default_role = "py:obj"

# a link to what is not there is a warning; types are prose here ("(..., 4, 4) array") and no links
nitpicky = True
nitpick_ignore_regex = [("py:(class|obj)", ".*")]

# attributes of the same name in several results are told apart by their class
suppress_warnings = ["ref.python"]

autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "all"
autodoc_type_aliases = {name: name for name in ("ArrayLike", "FloatArray", "Image")}
napoleon_google_docstring = False
napoleon_use_ivar = True

DOTTED = re.compile(r"pieper(?:\.[A-Za-z_]\w*)+")


def link_names(_: Sphinx, page: nodes.document) -> None:
    """Make links of the modules, functions and classes that a page names between backticks."""
    for code in list(page.findall(nodes.literal)):
        if DOTTED.fullmatch(code.astext()) and not isinstance(code.parent, nodes.reference | addnodes.pending_xref):
            name = code.astext()
            link = addnodes.pending_xref("", refdomain="py", reftype="obj", reftarget=name, refwarn=False)
            code.replace_self(link)
            link += code


def keep_whole(_: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Keep Napoleon from taking what stands before the colon in "Lower and upper limits: ..." for the type of a property."""
    if what in ("attribute", "data", "property"):
        lines[:0] = ["..", ""]  # a comment without words


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    TypeAliasForwardRef.__repr__ = lambda self: self.name  # `FloatArray | None`, and not the name of this class
    app.connect("autodoc-process-docstring", keep_whole, priority=400)  # before Napoleon
    app.connect("doctree-read", link_names)
