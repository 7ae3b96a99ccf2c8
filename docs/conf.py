"""How the pages are built: `sphinx-build -W --keep-going -n docs docs/_build/html`.

Code blocks that are marked `{run}` are executed, and so are the scripts of the gallery. Pages of the
reference are written from the code at each build, and the drawings by a script. No page loads anything from
the network.
"""

import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "building"))

from gallery_order import link_samples  # noqa: E402 - below docs, as the line above

link_samples()

project = "tssgeom"
author = "the authors of tssgeom"
project_copyright = "the authors of tssgeom, MIT licence"
release = version = re.findall(r"^version: (\S+)$", (HERE.parent / "CITATION.cff").read_text("utf-8"), re.M)[
    0
]

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "reference_pages",
    "drawings",
    "run_blocks",
    "subscripts",
]
exclude_patterns = ["_build", "gallery/*.md", "gallery/*.rst", "README.md"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
default_role = "literal"
nitpicky = True
nitpick_ignore = [("py:class", "numpy.ndarray")]  # documented elsewhere: the site works offline
suppress_warnings = ["config.cache"]

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 4

autodoc_member_order = "bysource"
toc_object_entries_show_parents = "hide"
autodoc_typehints = "none"  # numpy-style docstrings state it in words
autodoc_default_options = {"members": True}
autodoc_class_signature = "mixed"
napoleon_google_docstring = False
napoleon_use_ivar = False
python_use_unqualified_type_names = True

copybutton_exclude = ".linenos, .gp, .go"
copybutton_selector = "div:not(.output) > div.highlight > pre"

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "examples",
    "filename_pattern": r"\.py$",
    "ignore_pattern": r"__init__\.py",
    "within_subsection_order": "gallery_order.InOrder",
    "abort_on_example_error": True,
    "copyfile_regex": r"$^",
    "download_all_examples": False,
    "image_srcset": ["2x"],
    "min_reported_time": 10_000,
    "remove_config_comments": True,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "reset_modules": ("matplotlib", "gallery_order.plain_figures"),
    "ignore_repr_types": r"matplotlib\.",
}

html_theme = "pydata_sphinx_theme"
html_title = f"tssgeom {release}"
html_static_path = ["_static"]
html_sidebars = {"index": [], "tutorial": [], "glossary": [], "machines": []}
html_context = {"default_mode": "auto"}
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {
    "logo": {"text": "tssgeom"},
    "navbar_align": "left",
    "navbar_end": ["theme-switcher"],
    "header_links_before_dropdown": 7,
    "secondary_sidebar_items": {"[!h]**": ["page-toc"], "howto/*": []},  # printed tables fit
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
    "article_footer_items": [],
    "back_to_top_button": False,
}
