"""Mutate model files and ask the checker: none may crash it, hang it, or read outside its folder.

    python benchmarks/fuzz_models.py [--count 20000] [--first 0] [--minutes 60]

Mutant k is made by seed k alone: one of four small models (MJCF with meshes and an include, URDF of
a ROS package, a twin folder, OpenUSD) with one to three changes of numbers, attributes, elements,
names, bytes, encodings, meshes; or a bomb of entities, copies, sizes or nesting; or a name that
leaves the folder, which must be refused. Each is checked in a process of its own with the memory
that `check` gives one, forked from one that has checked the models unbroken: no mutant waits for
imports. Every fifth is checked by all checks, the others by those that need no simulation. Verdicts
are those of the command line: 0 passes, 1 fails, 2 refused; `crashed` is exit code 3, `killed` a
signal, `hung` more than 60 s, `escaped` a name outside that was not refused. Numbers go to
benchmarks/results/fuzz_models.json, the table to docs/checks.md; --look writes neither. --again
asks this code about the seeds that went wrong before, and --add adds its counts to those of before.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fuzz_bases import make_bases
from reconstruction_suite import git, insert

from part2gs_robotics.ci.alone import limit_memory

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/fuzz_models.json", ROOT / "docs/checks.md"
MARKS = "<!-- fuzz:begin -->", "<!-- fuzz:end -->"
HUNG = 60  # s; most mutants take a tenth of one
WHOLE = 5  # every so many-th mutant is simulated too
WRONG = ("crashed", "killed", "hung", "escaped")
STILL = ("compile", "files", "mesh", "inertia", "limits", "states")
WORDS = ("nan", "inf", "-inf", "1e308", "-1e308", "1e-308", "1e39", "0", "-1", "", " ", "a", "true",
         "99999999999", "0 0 0", "1 2 3 4 5 6 7 8 9 10", "%s%n", "\\x00", "0x7fffffff", "é")
OUTSIDE = ("../../secret.obj", "/etc/passwd", "a/../../../secret.obj", "file:///etc/passwd",
           "package://../../secret.obj", "..\\secret.obj", "meshes/../../../secret.obj")


def main() -> int:
    """Run, store, and write the table; return 1 where something crashed, hung or escaped."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=20_000, help="mutants")
    parser.add_argument("--first", type=int, default=0, help="seed of the first one")
    parser.add_argument("--minutes", type=float, default=60.0, help="stop after these")
    parser.add_argument("--look", action="store_true", help="write nothing")
    parser.add_argument("--add", action="store_true", help="add to the numbers stored")
    parser.add_argument("--again", action="store_true", help="only the seeds that went wrong")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        if args.again:
            found = again(Path(place), json.loads(RESULTS.read_text()))
        else:
            seeds = range(args.first, args.first + args.count)
            found = fuzz(Path(place), seeds, args.minutes * 60)
            found = added(json.loads(RESULTS.read_text()), found) if args.add else found
    table = markdown(found)
    sys.stdout.write(table)
    if not args.look:
        RESULTS.write_text(json.dumps(found, indent=1) + "\n")
        PAGE.write_text(insert(PAGE.read_text(), table, *MARKS))
    return int(any(w["verdict"] in WRONG for w in found.get("again", found["wrong"])))


def again(place: Path, stored: dict[str, Any]) -> dict[str, Any]:
    """Return stored numbers with what this code makes of every seed that went wrong."""
    bases, commit = make_bases(place / "bases"), git("rev-parse", "--short", "HEAD")
    for folder, main_file in bases.values():
        code_of(folder / main_file, None)
    found = [{"seed": w["seed"], "model": w["model"], "commit": commit,
              "verdict": one(bases, place / "mutant", w["seed"])[2]} for w in stored["wrong"]]
    return stored | {"again": found}


def added(stored: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    """Return the numbers of two runs over different seeds as one."""
    def both(a: dict[str, int], b: dict[str, int]) -> dict[str, int]:
        return dict(Counter(a) + Counter(b))

    names = sorted({*stored["models"], *more["models"]})
    return stored | {
        "commit": ", ".join(dict.fromkeys([stored["commit"], more["commit"]])),
        "mutants": stored["mutants"] + more["mutants"],
        "seconds": stored["seconds"] + more["seconds"],
        "slowest": max(stored["slowest"], more["slowest"]),
        "verdicts": both(stored["verdicts"], more["verdicts"]),
        "models": {n: both(stored["models"].get(n, {}), more["models"].get(n, {})) for n in names},
        "wrong": stored["wrong"] + more["wrong"]}


def fuzz(place: Path, seeds: range, seconds: float) -> dict[str, Any]:
    """Return counts of verdicts by model and of all, and what went wrong, by seed."""
    bases = make_bases(place / "bases")
    for folder, main_file in bases.values():  # here, so that children find everything imported
        code_of(folder / main_file, None)
    began, slowest, done = time.perf_counter(), 0.0, 0
    by_model, wrong = dict[str, Counter[str]](), []
    for seed in seeds:
        if time.perf_counter() - began > seconds:
            break
        started = time.perf_counter()
        name, what, verdict = one(bases, place / "mutant", seed)
        slowest, done = max(slowest, time.perf_counter() - started), done + 1
        by_model.setdefault(name, Counter())[verdict] += 1
        if verdict in WRONG:
            wrong.append({"seed": seed, "model": name, "what": what, "verdict": verdict})
    total = sum(by_model.values(), Counter())
    return {"commit": git("rev-parse", "--short", "HEAD"), "mutants": done,
            "seconds": round(time.perf_counter() - began), "slowest": round(slowest, 1),
            "verdicts": dict(total), "models": {k: dict(v) for k, v in sorted(by_model.items())},
            "wrong": wrong}


def one(bases: dict[str, tuple[Path, str]], place: Path, seed: int) -> tuple[str, str, str]:
    """Make and check the mutant of a seed; return model, what was done, and the verdict."""
    rng = random.Random(seed)
    name = rng.choices(list(bases), weights=(40, 30, 27, 3))[0]  # USD starts a process each
    base, main_file = bases[name]
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(base, place / "m")
    (place / "secret.obj").write_text("v 0 0 0\n")
    files = sorted(f for f in (place / "m").rglob("*") if f.suffix in (".xml", ".urdf", ".obj",
                                                                      ".usd", ".yaml"))
    target = rng.choice([f for f in files if f.name != "package.xml"])
    outside = target.suffix in (".xml", ".urdf") and rng.random() < 0.05
    what, data = "name outside", target.read_bytes()
    if outside:
        found = re.sub(rb'(file(?:name)?=")[^"]*', rb"\g<1>" + rng.choice(OUTSIDE).encode().replace(
            b"\\", b"\\\\"), data, count=1)
        outside, data = found != data, found
    else:
        steps = [rng.choice(DEEDS) for _ in range(rng.randint(1, 3))]
        for deed in steps:
            data = deed(data, rng)
        what = ", ".join(deed.__name__ for deed in steps)
    target.write_bytes(data)
    path = place / "m" / main_file if main_file else place / "m"
    verdict = checked(path, None if seed % WHOLE == 0 else STILL)
    return name, f"{target.name}: {what}", "escaped" if outside and verdict in (
        "passes", "fails") else verdict


def checked(path: Path, groups: tuple[str, ...] | None) -> str:
    """Return the verdict of a check, by some groups or all, in a process of its own."""
    child = os.fork()
    if child == 0:
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        signal.alarm(HUNG)
        limit_memory()
        os._exit(code_of(path, groups))
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return "hung" if os.WTERMSIG(status) == signal.SIGALRM else "killed"
    return ("passes", "fails", "refused", "crashed")[min(os.WEXITSTATUS(status), 3)]


def code_of(path: Path, groups: tuple[str, ...] | None) -> int:
    """Return the exit code that the command line would end with."""
    from part2gs_robotics.errors import Part2GSError
    from part2gs_robotics.sim_checks import check

    try:
        report = check(path, steps=3, quick=True, only=groups)
        json.dumps(report.to_dict(), allow_nan=False)
        return report.exit_code
    except (Part2GSError, MemoryError):
        return 2
    except BaseException:  # whatever it is, the command line would call it its own bug
        return 3


def number(data: bytes, rng: random.Random) -> bytes:
    """Put a word in the place of a number."""
    return _swap(data, rng, rb"-?\d+\.?\d*(?:e-?\d+)?", lambda _: rng.choice(WORDS).encode())


def attribute(data: bytes, rng: random.Random) -> bytes:
    """Put a word in the place of an attribute's value."""
    return _swap(data, rng, rb'"[^"]*"', lambda _: b'"' + rng.choice(WORDS).encode() + b'"')


def exchange(data: bytes, rng: random.Random) -> bytes:
    """Put one element in the place of another."""
    found = re.findall(rb"<[^<>]*/>", data)
    return _swap(data, rng, rb"<[^<>]*/>", lambda _: rng.choice(found)) if found else data


def repeat(data: bytes, rng: random.Random) -> bytes:
    """Write an element or line up to 200 times."""
    return _swap(data, rng, rb"<[^<>]*/>|\n[^\n]+", lambda old: old * rng.choice((0, 2, 3, 200)))


def byte(data: bytes, rng: random.Random) -> bytes:
    """Change one byte."""
    at = rng.randrange(len(data) or 1)
    return data[:at] + bytes([rng.randrange(256)]) + data[at + 1:]


def cut(data: bytes, rng: random.Random) -> bytes:
    """Leave some bytes out."""
    at = rng.randrange(len(data) or 1)
    return data[:at] + data[at + rng.choice((1, 10, 40, len(data))):]


def rename(data: bytes, rng: random.Random) -> bytes:
    """Give a name another value of the file: cycles, doubles, things that are of another kind."""
    found = re.findall(rb'"[A-Za-z_]\w*"', data)
    return _swap(data, rng, rb'"[A-Za-z_]\w*"', lambda _: rng.choice(found)) if found else data


def bomb(data: bytes, rng: random.Random) -> bytes:
    """Add what grows: entities, copies of copies, huge pictures and terrains, deep nesting."""
    body = data.rpartition(b"</")
    deep = b"<body>" * 3000 + b"</body>" * 3000
    copies = b'<replicate count="9999" offset="1 0 0">' * 3 + b'<geom size=".1"/>'
    inner = rng.choice([
        deep, b"<worldbody>" + copies + b"</replicate>" * 3 + b"</worldbody>",
        b'<asset><texture name="t" type="2d" builtin="flat" width="99999" height="99999"/></asset>',
        b'<asset><hfield name="f" nrow="99999" ncol="99999" size="1 1 1 1"/></asset>',
        b'<size memory="9999G"/>', b'<include file="m.xml"/>', b'<include file="twin.xml"/>',
        b'<size nuserdata="999999999"/>'])
    if rng.random() < 0.2:
        entities = b"".join(b'<!ENTITY e%d "%s">' % (k + 1, b"&e%d;" % k * 10) for k in range(9))
        return b'<!DOCTYPE m [<!ENTITY e0 "ha">' + entities + b"]>" + data
    return body[0] + inner + body[1] + body[2] if body[1] else data


def encoding(data: bytes, rng: random.Random) -> bytes:
    """Say or use another encoding."""
    name = rng.choice((b"utf-16", b"utf-32", b"ascii", b"none", b"base64", b"utf-7", b"idna"))
    head = b'<?xml version="1.0" encoding="' + name + b'"?>'
    text = re.sub(rb"<\?xml[^>]*\?>", b"", data)
    return head + text if rng.random() < 0.6 else text.decode("latin-1").encode("utf-16")


DEEDS: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    number, number, attribute, attribute, exchange, repeat, byte, cut, rename, bomb, encoding)


def _swap(data: bytes, rng: random.Random, pattern: bytes, new: Callable[[bytes], bytes]) -> bytes:
    found = list(re.finditer(pattern, data))
    if not found:
        return data
    one = rng.choice(found)
    return data[:one.start()] + new(one.group()) + data[one.end():]


def markdown(found: dict[str, Any]) -> str:
    """Return a line and a table of verdicts by model."""
    verdicts = ("passes", "fails", "refused", "crashed", "killed", "hung", "escaped")
    lines = [f"{found['mutants']} mutated files ({found['commit']}) in {found['seconds']} s, the "
             f"slowest {found['slowest']} s.", "", f"| model | {' | '.join(verdicts)} |",
             "|---|" + "--:|" * len(verdicts)]
    rows = [*found["models"].items(), ("all", found["verdicts"])]
    lines += [f"| {name} | {' | '.join(str(row.get(v, 0)) for v in verdicts)} |"
              for name, row in rows]
    told = ", ".join(f"{w['seed']} ({w['model']}) {w['verdict']}" for w in found.get("again", []))
    if told:
        lines += ["", "What was crashed or killed there was mended; those seeds today "
                  f"({found['again'][0]['commit']}): {told}."]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
