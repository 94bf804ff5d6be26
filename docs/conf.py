"""Sphinx's configuration of the documentation; scripts/docs builds it."""
import os
import re
import shutil
import sys
import typing
from pathlib import Path

from docutils import nodes
from sphinx import addnodes
from sphinx.domains.c import CDomain
from sphinx.domains.cpp import CPPDomain

root = Path(__file__).resolve().parent.parent

project = "BroadCL"
author = "the BroadCL authors"
header = (root / "host/broadcl/version.h").read_text()
release = ".".join(re.search(rf"BROADCL_VERSION_{part} (\d+)", header)[1] for part in ("MAJOR", "MINOR", "PATCH"))
version = release

extensions = ["myst_parser", "breathe", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
primary_domain = "cpp"
highlight_language = "text"
toc_object_entries_show_parents = "hide"

breathe_projects = {"broadcl": os.environ["BROADCL_DOXYGEN_XML"]}
breathe_default_project = "broadcl"
breathe_default_members = ("members", "undoc-members")
breathe_domain_by_extension = {"h": "c"}

# The package with the stubs of its extension in place of the extension. Of overloads, the first has the description.
sys.path.insert(0, os.environ["BROADCL_PYTHON_STUBS"])
typing.overload = lambda function: sys._getframe(1).f_locals.get(function.__name__, function)
autodoc_mock_imports = ["numpy", "pyopencl"]
autodoc_typehints = "none"
autodoc_member_order = "bysource"
default_role = "py:obj"
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"BroadCL {release}"
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {
    "light_css_variables": {"color-api-name": "#7a3e00", "color-api-pre-name": "#7a3e00"},
    "dark_css_variables": {"color-api-name": "#ffb86b", "color-api-pre-name": "#ffb86b"},
}
pygments_style = "default"
pygments_dark_style = "github-dark"


def list_objects(app, doctree):
    """Lists functions and types of C and C++ in the contents of a page, as Sphinx does those of Python."""
    listed = set()
    for signature in doctree.findall(addnodes.desc_signature):
        kind, name = signature.parent["objtype"], signature.next_node(addnodes.desc_name)
        if signature.parent["domain"] not in ("c", "cpp") or name is None or not name.astext().isidentifier():
            continue
        outer = signature.parent.parent
        while outer is not None and not isinstance(outer, addnodes.desc):
            outer = outer.parent
        parents = outer[0].get("_toc_parts", ()) if outer is not None else ()
        parts = (*parents, name.astext())
        is_constructor = parts[-2:-1] == parts[-1:]
        is_field = bool(parents) and kind in ("member", "var")
        if parts in listed or is_constructor or is_field:
            continue
        listed.add(parts)
        signature["_toc_parts"], signature["_toc_name"] = parts, name.astext()


def searchable(get_objects):
    """What the search finds in C and C++: first classes and functions, then members; no parameters."""
    def found(domain):
        for name, shown, kind, *place, _ in get_objects(domain):
            if kind != "functionParam":
                yield name, shown, kind, *place, 1 if name.count("::") > 1 or "." in name else 0
    return found


CDomain.get_objects = searchable(CDomain.get_objects)
CPPDomain.get_objects = searchable(CPPDomain.get_objects)

# Files and folders of the repository that pages link to are shown on pages of the site, or copied if a browser can show them.
languages = {".cl": "c", ".cpp": "cpp", ".h": "c", ".hpp": "cpp", ".md": "markdown", ".py": "python", ".txt": "text"}


def address_of(path):
    name = f"repository/{path.relative_to(root)}"
    return f"{name}.html" if path.is_dir() or path.suffix in languages else name


def link_to_repository(app, doctree):
    linked = set()
    for node in list(doctree.findall(nodes.Element)):
        if node.get("reftype") != "myst":
            continue
        path = (Path(app.srcdir) / node["reftarget"].partition("#")[0]).resolve()
        if path.exists() and root in path.parents and Path(app.srcdir) not in (path, *path.parents):
            linked.add(path)
            node.replace_self(nodes.reference("", "", *node[0].children, internal=True, refuri=address_of(path)))
    app.env.metadata[app.env.docname]["repository"] = linked


def show_repository(app):
    linked = {path for page in app.env.metadata.values() for path in page.get("repository", ())}
    for path in sorted(linked.union(*(path.rglob("*") for path in linked))):
        address = address_of(path)
        if path.is_dir():
            inner = (f"{path.name}/{Path(address_of(inner)).name}" for inner in sorted(path.iterdir()))
            body = "".join(f'<p><a href="{name}">{name.removesuffix(".html")}</a></p>' for name in inner)
        elif path.suffix in languages:
            body = f'<div class="source">{app.builder.highlighter.highlight_block(path.read_text(), languages[path.suffix])}</div>'
        else:
            copy = Path(app.outdir) / address
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, copy)
            continue
        title = str(path.relative_to(root))
        yield address.removesuffix(".html"), {"title": title, "body": f"<h1><code>{title}</code></h1>{body}"}, "page.html"


def setup(app):
    app.connect("doctree-read", list_objects, priority=400)
    app.connect("doctree-read", link_to_repository, priority=400)
    app.connect("html-collect-pages", show_repository)
