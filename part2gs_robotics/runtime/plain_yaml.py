"""YAML of others: plain values only, no alias, no deep nesting, in linear time."""

from __future__ import annotations

from pathlib import Path

import yaml

# Both are safe; the one in C is ten times faster, and its scanner is not quadratic in brackets.
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class NotPlainError(ValueError):
    """No YAML, an alias, which can repeat itself into gigabytes, or nesting of no plain value."""


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


def read_plain_file(path: Path, most: int, deepest: int) -> object:
    """Return the value of a YAML file.

    Args:
        path: of the file.
        most: bytes it may have.
        deepest: see `read_plain`.

    Raises:
        NotPlainError: too large, not readable, or anything that `read_plain` refuses.
    """
    try:
        if (size := path.stat().st_size) > most:
            raise NotPlainError(f"has {size} bytes, more than {most}")
        return read_plain(path.read_text("utf-8"), deepest)
    except NotPlainError:
        raise
    except (OSError, ValueError, yaml.YAMLError, RecursionError) as err:
        reason = " ".join(str(err).split())[:120] or type(err).__name__
        raise NotPlainError(f"cannot be read as YAML ({reason})") from err
