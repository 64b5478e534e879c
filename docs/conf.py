"""The documentation site: `make docs` builds it without a network, into build/docs."""

import sys
from pathlib import Path

from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent))

from generated import write  # what commands, tables and notebooks say, written below docs/generated

project = "cooploc"
author = "the cooploc developers"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}
exclude_patterns = ["requirements.lock"]
nb_execution_mode = "off"  # the notebooks keep their outputs; tests run them
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
suppress_warnings = ["myst.header"]  # some notebooks begin with a second-level heading
html_theme = "pydata_sphinx_theme"
html_title = "cooploc"
html_static_path = ["static"]
html_css_files = ["tables.css"]
html_show_sourcelink = False
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "footer_end": [],
}
napoleon_custom_sections = [(name, "params_style") for name in ("Columns", "More columns", "Optional members")]
python_use_unqualified_type_names = True
autodoc_typehints = "description"  # beside each parameter's meaning, so that signatures can be read
autodoc_typehints_description_target = "documented_params"
autodoc_member_order = "bysource"

write(Path(__file__).parent / "generated")


def setup(app: Sphinx) -> None:
    """Links into reports/, which lead to files in the repository, lead to their pages here."""

    def redirect(app: Sphinx, page: str, source: list[str]) -> None:
        source[0] = source[0].replace("](../../reports/", "](../generated/reports/")

    app.connect("source-read", redirect)
