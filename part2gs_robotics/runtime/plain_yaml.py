"""YAML of others: plain values only, no alias, no deep nesting, in linear time."""

from __future__ import annotations

import yaml

# Both are safe; the one in C is ten times faster, and its scanner is not quadratic in brackets.
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class NotPlainError(ValueError):
    """An alias, which can repeat itself into gigabytes, or nesting that plain values never have."""


def read_plain(text: str, deepest: int) -> object:
    """Return the value of a YAML document.

    Args:
        text: of the document.
        deepest: most lists and mappings inside each other; a loader crashes on thousands.

    Raises:
        NotPlainError: it uses an alias or nests deeper.
        ValueError: a value that is none, such as a date in month 13.
        yaml.YAMLError: it is no YAML, or asks for an object.
    """
    depth = 0
    for event in yaml.parse(text, Loader=LOADER):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if isinstance(event, yaml.AliasEvent):
            raise NotPlainError("uses a YAML alias (*name)")
        if depth > deepest:
            raise NotPlainError(f"nests deeper than {deepest}")
    return LOADER(text).get_single_data()
