"""Settings of the site, which `make docs` builds."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # for what is beside the package: docs.site

import pcm_gym

project = "pcm_gym"
author = copyright = "pcm_gym contributors"
version = release = pcm_gym.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "docs.site.links",
]
exclude_patterns = ["_build", "**/templates"]
default_role = "py:obj"  # `name` in a docstring is a link where there is such a name, and code elsewhere

html_theme = "furo"
html_title = f"pcm_gym {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False

myst_heading_anchors = 3
myst_enable_extensions = ["attrs_inline"]

# The tutorials are run at each build; one that fails, fails the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # s for a cell: the first one may have to compile the kernels
nb_execution_show_tb = True
nb_merge_streams = True

autodoc_mock_imports = ["torch"]  # which building the site does not take
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
autodoc_typehints = "none"  # numpydoc says them
napoleon_google_docstring = False
napoleon_use_ivar = True  # attributes stand in the class's own list
napoleon_use_rtype = False
napoleon_custom_sections = ["Options", "Loss of stability", "Version history"]

copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
