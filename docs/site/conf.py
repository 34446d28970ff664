# SPDX-License-Identifier: BSD-3-Clause
"""Sphinx's configuration of the site, which build.py starts."""

import os
import re
from importlib import import_module
from pathlib import Path

from docutils.nodes import emphasis
from sphinx.addnodes import pending_xref
from sphinx.domains.python import PyObject
from sphinx.util.nodes import make_refnode

project = "tokid"
author = "the tokid authors"
copyright = "the tokid authors"  # noqa: A001
release = version = os.environ["TOKID_DOCS_VERSION"]

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon", "sphinx.ext.mathjax",
              "sphinx_design", "sphinx_copybutton"]
root_doc = "index"
exclude_patterns = ["gallery/downloads"]
templates_path = []
# Docstrings have parameters and other words in backticks and types. Names of classes must be there, but for those of
# other packages and the capitals of the mathematics.
WORDS = r"(?!tokid\.)[^A-Z].*|[A-Z][a-z]?(\W.*)?|None.*|True|False|DataFrame|Dataset|GridSearchCV"
nitpick_ignore_regex = [
    (r"cpp:identifier", r"(std|Eigen)(::.*)?|size_t|Clock::.*"),  # other libraries, private names
    (r"py:.*", WORDS),
]

# ---- Markdown ----
myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_dmath_double_inline = True
myst_heading_anchors = 6
nb_execution_mode = "off"  # the outputs are in the notebooks
nb_number_source_lines = False

# ---- Python ----
autodoc_member_order = "groupwise"
autodoc_typehints = "none"
python_maximum_signature_line_length = 80
python_use_unqualified_type_names = True
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
default_role = "py:obj"
autosummary_generate = False

# ---- C++ ----
cpp_maximum_signature_line_length = 80
cpp_index_common_prefix = ["tokid::"]

# ---- Pages ----
html_theme = "pydata_sphinx_theme"
html_title = "tokid"
html_static_path = ["static", os.environ["TOKID_DOCS_STATIC"]]
mathjax_path = "mathjax/tex-chtml.js"
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_show_sourcelink = False
html_copy_source = False
copybutton_exclude = ".linenos, .gp, .go"
switcher = os.environ.get("TOKID_DOCS_SWITCHER", "_static/switcher.json")  # a URL, or a file of the site
html_context = {"default_mode": "auto"}
html_theme_options = {
    "switcher": {"json_url": switcher, "version_match": release},
    "check_switcher": False,
    "navbar_start": ["navbar-logo"],
    "navbar_end": ["version-switcher", "theme-switcher"],
    "navbar_align": "left",
    "header_links_before_dropdown": 8,
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "show_prev_next": True,
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "tango",
    "pygments_dark_style": "github-dark",
    "logo": {"text": f"tokid {release}"},
}
html_sidebars = {"index": [], "install": [], "tutorial": []}  # which have no pages below


def words_stay_words(app, doctree):
    """Words of types, such as "shape (n, n)", are no links to members that have their name."""
    for node in list(doctree.findall(pending_xref)):
        if node.get("refdomain") == "py" and node.get("refspecific") and re.fullmatch(WORDS, node["reftarget"]):
            node.replace_self(emphasis("", node["reftarget"]))


def public_name(app, env, node, contnode):
    """Docstrings name what is in tokid without the module, such as `Model.at`. Fields are described with their class."""
    if node.get("refdomain") != "py":
        return None
    known, target = env.domains.python_domain.objects, node["reftarget"]
    for prefix in ("tokid.", "tokid.results.", "tokid.stages."):
        owner, _, field = target.partition(".")
        name = prefix + (owner if field.split(".")[0] in field_names(prefix + owner) else target)
        if name in known:
            return make_refnode(app.builder, node["refdoc"], known[name].docname, known[name].node_id, contnode, name)
    return None


def field_names(name):
    """The fields of a dataclass of tokid."""
    module, _, last = name.rpartition(".")
    return getattr(getattr(import_module(module), last, None), "__dataclass_fields__", ())


def plain_docstring(app, what, name, thing, options, lines):
    """Names of documents become links, bars are no substitutions, and the first words of a description are no type."""
    def link(match):
        return f":doc:`/{match[1]}`" if (app.srcdir / f"{match[1]}.md").exists() else match[0]

    lines[:] = [re.sub(r"`?docs/([\w/-]+)\.md`?", link, line.replace("|", "\\|")) for line in lines]
    if what == "class":
        lines[:] = separate_fields(lines)
    if what in ("attribute", "data", "property") and lines and ": " in lines[0]:
        before, _, after = lines[0].partition(": ")
        lines[:1] = [f"{before}:", after]


def separate_fields(lines):
    """Attributes that share a line, "a, b : float", get lines of their own, as Napoleon does it for parameters."""
    rest, out = list(lines), []
    while rest:
        line = rest.pop(0)
        names, mark, kind = line.partition(" : ")
        if not mark or not re.fullmatch(r"\w+(, \w+)+", names):
            out.append(line)
            continue
        body = []
        while rest and (rest[0].startswith(" ") or (not rest[0] and len(rest) > 1 and rest[1].startswith(" "))):
            body.append(rest.pop(0))
        out += [part for name in names.split(", ") for part in (f"{name} : {kind}", *body)]
    return out


def fields_alone(app, what, name, thing, options, signature, returns):
    """Results are made by tokid, not by users: their fields matter, not how they are constructed."""
    return ("", None) if what == "class" and thing.__module__ == "tokid.results" else None


site_code = Path(__file__).read_text(encoding="utf-8")  # all pages are read again when it changes


def setup(app):
    app.add_config_value("site_code", "", "env")
    for field in PyObject.doc_field_types:
        if field.name == "variable":
            field.label = "Fields"
    app.connect("autodoc-process-docstring", plain_docstring, priority=400)  # before Napoleon
    app.connect("autodoc-process-signature", fields_alone)
    app.connect("missing-reference", public_name)
    app.connect("doctree-read", words_stay_words)
