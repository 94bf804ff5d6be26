"""Sphinx's configuration of the documentation; scripts/docs builds it."""
import os
import re
from pathlib import Path

root = Path(__file__).parent.parent

project = "BroadCL"
author = "the BroadCL authors"
header = (root / "host/broadcl/version.h").read_text()
release = ".".join(re.search(rf"BROADCL_VERSION_{part} (\d+)", header)[1] for part in ("MAJOR", "MINOR", "PATCH"))
version = release

extensions = ["myst_parser", "breathe"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
exclude_patterns = ["study.md", "testing.md"]  # for those who have the sources
breathe_projects = {"broadcl": os.environ["BROADCL_DOXYGEN_XML"]}
breathe_default_project = "broadcl"
breathe_default_members = ("members", "undoc-members")
primary_domain = "cpp"
highlight_language = "text"

html_theme = "furo"
html_title = f"BroadCL {release}"
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
