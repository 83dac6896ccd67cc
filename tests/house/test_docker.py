"""The Dockerfile, read as text: what it copies is there, pins hold, and it ends without rights."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "Dockerfile").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def instructions(text: str) -> list[tuple[str, str]]:
    """Return (instruction, its words on one line), comments left out."""
    lines = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    joined = re.sub(r"\s*\\\n\s*", " ", lines)
    return [(line.split(" ", 1)[0], line.split(" ", 1)[1]) for line in joined.splitlines() if line]


def copied(text: str) -> set[str]:
    return {word for name, words in instructions(text) if name == "COPY"
            for word in words.split()[:-1]}


def faults(text: str) -> list[str]:
    """Return what is wrong with a Dockerfile for this repository."""
    found, steps = [], instructions(text)
    found += [f"copies {name}, which is not there" for name in copied(text)
              if not (ROOT / name).exists()]
    tools = PROJECT["tool"]["setuptools"]
    needed = {"constraints.txt", "pyproject.toml", "setup.py", "setup.cfg", "part2gs_robotics",
              PROJECT["project"]["readme"], *tools["package-dir"].values()}
    needed |= {pattern.split("/")[0] for files in tools["data-files"].values() for pattern in files}
    found += [f"does not copy {name}" for name in sorted(needed - copied(text))]
    runs = [words for name, words in steps if name == "RUN"]
    for call in re.findall(r"pip install.*?(?=&&|$)", "\n".join(runs), re.MULTILINE):
        if "-c constraints.txt" not in call:
            found.append(f"installs without pins: {call}")
        for extra in ",".join(re.findall(r"\[([\w,]+)\]", call)).split(","):
            if extra and extra not in PROJECT["project"]["optional-dependencies"]:
                found.append(f"no extra {extra}")
    listed = re.search(r"^APT := (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    wanted = set(listed[1].split()) if listed else set()
    got = re.search(r"apt-get install((?: [\w.+-]+)+)", "\n".join(runs))
    if {word for word in (got[1].split() if got else ()) if word[0] != "-"} != wanted:
        found.append("libraries are not those of the Makefile")
    names = [name for name, _ in steps]
    users = [words for name, words in steps if name == "USER"]
    if not users or users[-1] in ("root", "0") or "RUN" in names[names.index("USER"):]:
        found.append("runs as root")
    entry = [json.loads(words) for name, words in steps if name == "ENTRYPOINT"]
    if not entry or entry[-1][0] not in PROJECT["project"]["scripts"]:
        found.append("starts another program")
    if not re.fullmatch(r"python:3\.\d+-[\w-]+", dict(steps)["FROM"]):
        found.append("base without a version")
    return found


def test_the_dockerfile_is_sound() -> None:
    assert faults(TEXT) == []


@pytest.mark.parametrize(("part", "other", "fault"), [
    ("COPY resource resource\n", "", "does not copy resource"),
    ("COPY launch launch", "COPY launcher launch", "copies launcher"),
    ("-c constraints.txt --no-build", "--no-build", "without pins"),
    ("photos,usd", "photos,usb", "no extra usb"), (" libgles2", "", "libraries"),
    ("USER robot\n", "", "runs as root"), ("USER robot", "USER root", "runs as root"),
    ('["part2gs-robot"]', '["python"]', "another program"), (":3.11-slim-bookworm", "", "base"),
])  # fmt: skip
def test_a_planted_fault_is_found(part: str, other: str, fault: str) -> None:
    assert part in TEXT
    assert any(fault in found for found in faults(TEXT.replace(part, other)))


def test_the_context_holds_what_is_copied_and_no_more() -> None:
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    assert lines[1] == "*"
    assert {line[1:] for line in lines if line.startswith("!")} == copied(TEXT)


def test_setuptools_is_pinned() -> None:
    assert "setuptools==" in (ROOT / "constraints.txt").read_text()
