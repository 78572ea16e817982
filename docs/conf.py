"""Sphinx: the documentation of ground (make docs). Pages are MyST Markdown, mathematics is KaTeX."""

import os
import sys
import xml.etree.ElementTree as ElementTree

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(HERE)
KATEX = "/usr/share/javascript/katex"  # from Debian's package libjs-katex
sys.path.insert(0, HERE)

project = "ground"
author = "the ground team"
copyright = author
release = ElementTree.parse(os.path.join(ROOT, "src/ground/package.xml")).findtext("version")
extensions = ["myst_parser", "from_code", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
exclude_patterns = ["schemas"]
smartquotes = False  # they would turn --option into a dash
nitpicky = True  # a broken reference is a warning, and warnings fail make docs
nitpick_ignore_regex = [("py:.*", ".*")]  # types of other packages have no page here
autodoc_member_order = "bysource"
autodoc_typehints = "description"  # signatures are for reading
autodoc_typehints_description_target = "documented"
napoleon_google_docstring = False

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3

html_theme = "furo"
html_title = "ground %s" % release
html_static_path = ["_static", KATEX]
html_css_files = ["katex.min.css", "ground.css"]
html_show_sphinx = False
# KaTeX, because MathJax is loaded from the network.
mathjax_path = "math.js"
mathjax_options = {"defer": "defer"}
html_js_files = [("katex.min.js", {"defer": "defer"})]

linkcheck_timeout = 10
linkcheck_anchors = False


def prepared(app, what, name, thing, options, lines):
    """Changes the lines of a docstring into what napoleon understands."""
    if what in ("attribute", "property") and lines:
        lines[0] = ": " + lines[0]  # a type, here none, ends with the first colon
    elif "Attributes" in lines:  # the members follow with the same text
        start = lines.index("Attributes")
        del lines[start : lines.index("Examples", start) if "Examples" in lines[start:] else None]


def setup(app):
    app.connect("autodoc-process-docstring", prepared, priority=400)  # napoleon's is 500
