"""Small pieces of HTML."""

from __future__ import annotations

import html
import json
import re
from typing import Any


def escaped(text: Any) -> str:
    return html.escape(str(text))


def prose(text: str) -> str:
    """Escaped text, with `names` set as code."""
    return re.sub("`([^`]+)`", r"<code>\1</code>", escaped(text))


def listed(sentences: list[str]) -> str:
    return "<ul>" + "".join(f"<li>{prose(s)}</li>" for s in sentences) + "</ul>"


def script_json(name: str, data: Any) -> str:
    """Data for the page's scripts, which cannot end the element early."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return f'<script type="application/json" id="{escaped(name)}">{text}</script>'


def inline_script(source: str) -> str:
    """A script, with its strings and comments kept from ending the element early."""
    return "<script>" + re.sub("</(script)", r"<\\/\1", source, flags=re.I) + "</script>"
