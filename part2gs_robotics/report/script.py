"""The scripts of the page, inlined: three.js as published, and what moves the twin with it."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from functools import cache
from importlib import resources

THREE = "three.module.min.js"  # three.js 0.170.0 as on npm; the last release in one file


def script(name: str) -> str:
    """Return the text of one script of this folder, safe inside a `script` element.

    Raises:
        ValueError: it holds what would end the element.
    """
    text = resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
    if re.search(r"</script|<!--", text, re.IGNORECASE):
        raise ValueError(f"{name} would end the element that holds it")
    return text


@cache
def page_script() -> str:
    """Return all code of the page as one script that leaves one name behind, `twin`."""
    licence = script("three.LICENSE.txt").replace("*/", "")
    return (f"/*\n{licence}*/\nconst THREE = (() => {{\n{_as_function(script(THREE))}\n}})();\n"
            f"(() => {{\n{script('viewer.js')}\n}})();\n(() => {{\n{script('page.js')}\n}})();\n")


def policy(text: str) -> str:
    """Return the page's content security policy: this script alone runs, nothing is fetched."""
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return ("default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
            f"script-src 'sha256-{digest}'")


def json_script(name: str, content: object) -> str:
    """Return an element that holds plain data for the scripts; no text in it can end it."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return f'<script type="application/json" id="{name}">{text}</script>'


def _as_function(module: str) -> str:
    """Return the body of a function that returns what a module exports.

    An inline script cannot be imported by another: the list behind `export` becomes an object.
    """
    body, word, names = module.rpartition("export{")
    pairs = [entry.split(" as ") for entry in names.rstrip().rstrip(";}").split(",")]
    if not word or not all(len(pair) == 2 for pair in pairs):
        raise ValueError(f"{THREE} does not end with its list of exports")
    return f'"use strict";{body}return{{{",".join(f"{new}:{own}" for own, new in pairs)}}};'
