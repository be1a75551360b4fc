"""Settings of the documentation (`make docs`): Sphinx with MyST Markdown, the pydata theme, a gallery of examples."""

import logging
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]

from wsnsim import __version__  # noqa: E402

project = "wsnsim"
author = "the wsnsim developers"
project_copyright = "the wsnsim authors"
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx_design",
    "sphinx_copybutton",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "wsnsim_reference",
]
exclude_patterns = ["_ext", "gallery/**/*.ipynb", "**/sg_execution_times.rst", "sg_execution_times.rst"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4  # a link to FILE.md#heading works as on GitHub

default_role = "code"
autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_type_aliases = {name: f"~wsnsim.plugins.{name}" for name in ("Bools", "Floats", "Ints", "Keys")} | {
    "Flow": "~wsnsim.Flow", "NodeId": "int", "Reading": "Reading", "Point": "Point"
}  # fmt: skip
python_maximum_signature_line_length = 120
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

copybutton_prompt_text = "$ "
copybutton_only_copy_prompt_lines = True

sphinx_gallery_conf = {
    "examples_dirs": ["../examples"],
    "gallery_dirs": ["gallery"],
    "filename_pattern": r"plot_\w+\.py",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_signature": False,
    "remove_config_comments": True,
    "within_subsection_order": "FileNameSortKey",
}

html_domain_indices = False  # the reference is ordered by what names are for, not by modules
html_theme = "pydata_sphinx_theme"
html_title = f"wsnsim {release}"
html_static_path = ["_static"]
html_favicon = html_logo = "_static/logo.svg"
html_css_files = ["wsnsim.css"]
html_show_sourcelink = False
html_copy_source = False
html_context = {"default_mode": "auto"}
html_sidebars = {name: [] for name in ("index", "glossary", "bibliography", "security", "changelog")}  # no pages below
html_theme_options = {
    "logo": {"text": "wsnsim", "alt_text": "wsnsim: the start page"},
    "header_links_before_dropdown": 6,
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": ["theme-version"],
    "secondary_sidebar_items": ["page-toc"],
}

# `*` in the contents of a folder stands for further pages; there may be none.
logging.getLogger("sphinx.sphinx.directives.other").addFilter(lambda record: "didn't match any" not in str(record.msg))
