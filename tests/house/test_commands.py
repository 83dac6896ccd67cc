"""Every command on the pages: its flags, files and targets exist, and what takes seconds is run."""

from __future__ import annotations

import re
import shlex
import shutil
import tomllib
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import get_args

import pytest
import yaml
from synth import handled_twin

from part2gs_robotics import api, cli
from part2gs_robotics.config import resolve
from part2gs_robotics.flags import COMMANDS, SHORT, command_options, parse

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "examples/README.md",
         *sorted((ROOT / "docs").glob("*.md"))]  # fmt: skip
OURS = "part2gs-robot"
NOT_RUN = {  # parsed to the end all the same
    "build": "takes minutes; tests/corridor builds",
    "scene": "takes minutes; tests/photos registers photos",
    "batch": "builds many scenes; tests/commands does",
    "view": "serves until Ctrl-C; tests/view asks it for its page",
    "capture": "needs the model of another; tests/capture renders",
}
IN_SCRIPTS = {"--twins"}  # flags that prose gives without the script of benchmarks/ they belong to


def shell(text: str) -> Iterator[str]:
    """Yield the lines of a page's code: indented blocks, fenced ones, what YAML of a CI runs."""
    fence, began = None, ""
    for line in text.splitlines():
        if line.startswith("```"):
            fence = line[3:].strip() if fence is None else None
            continue
        if fence == "yaml" and (found := re.match(r"\s*(?:- )?(run|entry): (.*)", line)):
            yield found[2] + (" out/" if found[1] == "entry" else "")  # pre-commit adds files
        if fence in ("", "sh", "bash") or (fence is None and line.startswith("    ")):
            began += line.strip()
            if began.endswith("\\"):
                began = began[:-1]
                continue
            yield began
            began = ""


def fenced(text: str, language: str) -> list[str]:
    """Return a page's code of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)


def words_of(line: str) -> list[str]:
    """Return a command's words: comments left away, what is optional given."""
    plain = re.sub(r"(?<![\w.'])\[([^\]]*)\]", r"\1", line)  # '.[usd]' is no option
    return shlex.split(plain, comments=True)


def ours(words: list[str]) -> None:
    """Parse a call of the program by its own parser, which judges values too."""
    call = parse(words)
    if call.command == "build":
        resolve(call.flags)  # two scales, for example
    if call.command == "export":
        assert "format" in call.flags, "export needs --format"


def of_make(words: list[str]) -> None:
    text = (ROOT / "Makefile").read_text()
    for target in (word for word in words if "=" not in word):
        assert re.search(rf"^{re.escape(target)}:", text, re.MULTILINE), f"no target {target}"


def of_pip(words: list[str]) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for extra in re.findall(r"(?:^|\s)(?:\.|part2gs-robotics)\[([\w,]+)\]", " ".join(words)):
        assert set(extra.split(",")) <= set(project["optional-dependencies"]), f"no extra {extra}"


def of_python(words: list[str]) -> None:
    if words[0] == "-m":
        assert find_spec(words[1]), f"no module {words[1]}"
        return
    script = ROOT / words[0]
    assert script.is_file(), f"no file {words[0]}"
    near = "".join(path.read_text() for path in (script, script.with_name("cases.py"))
                   if path.is_file())
    for word in words[1:]:
        assert not word.startswith("--") or f'"{word}"' in near, f"{words[0]} knows no {word}"


def of_ros(words: list[str]) -> None:
    if words[:2] == ["launch", "part2gs_robotics"]:
        script = ROOT / "launch" / words[2]
        assert script.is_file(), f"no launch file {words[2]}"
        for name in (word.partition(":=")[0] for word in words[3:]):
            assert name in script.read_text(), f"{words[2]} has no argument {name}"


def of_docker(words: list[str]) -> None:
    assert (ROOT / "Dockerfile").is_file()
    if words[0] == "run":  # its entry point is the program
        ours(words[words.index("part2gs-robotics") + 1:])


def of_jupyter(words: list[str]) -> None:
    assert (ROOT / words[-1]).is_file(), f"no file {words[-1]}"


PROGRAMS: dict[str, Callable[[list[str]], None]] = {
    OURS: ours, "make": of_make, "pip": of_pip, "python": of_python, "ros2": of_ros,
    "docker": of_docker, "jupyter": of_jupyter}  # fmt: skip


def calls(line: str) -> Iterator[list[str]]:
    """Yield the calls of a line, without what is set before them and where their output goes."""
    for alone in " ".join(shlex.quote(word) for word in words_of(line)).split(" '&&' "):
        words = shlex.split(alone)
        while words and re.fullmatch(r"[A-Z_]+=\S*|sudo", words[0]):
            words = words[1:]
        yield words[:words.index(">")] if ">" in words else words


def judge(line: str) -> None:
    """Fail if a line of code calls something that is not there; other programs are not ours."""
    for words in calls(line):
        if words and words[0] in PROGRAMS:
            PROGRAMS[words[0]](words[1:])


def commands(program: str = "") -> list[tuple[str, str]]:
    """Return page and line of every command in code, or of those of one program."""
    return [(str(page.relative_to(ROOT)), line) for page in PAGES
            for line in shell(page.read_text())
            if {word.strip("'") for word in line.split(" ")} & ({program} if program
                                                               else set(PROGRAMS))]


def test_every_command_is_shown_in_code_somewhere() -> None:
    found = {words[1] for _, line in commands(OURS) for words in calls(line) if words[0] == OURS}
    assert found == set(COMMANDS) - {"completion"}, "shells differ: its help shows it"


@pytest.mark.parametrize("line", sorted({
    f"{OURS} {example.split('  ')[0]}" for command in COMMANDS.values()
    for example in command.examples}))
def test_an_example_in_a_help_is_one(line: str) -> None:
    judge(line)


@pytest.mark.parametrize(("page", "line"), commands())
def test_a_command_on_a_page_is_one(page: str, line: str) -> None:
    judge(line)


@pytest.mark.parametrize("line", [
    "part2gs-robot build scene/ --meshes 3", "part2gs-robot build scene/ --no-parts",
    "part2gs-robot bild scene/", "part2gs-robot build", "part2gs-robot build a b c",
    "part2gs-robot build scene/ --preset finest", "part2gs-robot build s [--parts 0] # most",
    "part2gs-robot check out/ --format xml > a", "part2gs-robot export out/ -o x",
    "part2gs-robot build s --scale 1 --known-length 2",
    "MUJOCO_GL=egl part2gs-robot capture m.xml scene/ --shots 3", "make demos",
    "pip install '.[uds]'", "python benchmarks/rastr.py", "python benchmarks/raster.py --fast",
    "ros2 launch part2gs_robotics show.launch.py", "jupyter notebook examples/none.ipynb",
    "ros2 launch part2gs_robotics display.launch.py modell:=a",
    "docker run --rm -v $PWD:/data part2gs-robotics build scene --outt x",
])  # fmt: skip
def test_a_planted_one_is_found(line: str) -> None:
    with pytest.raises((cli.Part2GSError, AssertionError)):
        judge(line)


def spans(page: Path) -> list[str]:
    """Return what stands in backticks, code blocks and texts to search for left out."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    lines = [line.split("|", 2)[2] if line.startswith("|") and page.stem == "troubleshooting"
             else line for line in text.splitlines() if not line.startswith("    ")]
    return re.findall(r"`([^`\n]+)`", "\n".join(lines).replace("\\|", "|"))


def every_flag() -> set[str]:
    found = {"--help", "--version"}
    for name in COMMANDS:
        for option in command_options(name).values():
            found |= {option.flag, *SHORT.get(option.name, [])}
            found |= {f"--no-{option.flag[2:]}"} if option.kinds[0] is bool else set()
    return found


def mentioned(span: str) -> None:
    """Fail if a command or flag that prose mentions is none of the program's."""
    words = span.split()
    if words[0] == OURS and len(words) > 1 and not words[1].startswith("-"):
        assert words[1] in {*COMMANDS, "COMMAND"}, f"no command {words[1]}"
    if words[0] == OURS or words[0].startswith("--"):
        for word in re.findall(r"--[a-z][\w-]*", span):
            assert word in every_flag() | IN_SCRIPTS, f"no flag {word}"
    if words[0] in ("--preset", "--format", "--device") and len(words) == 2:
        near = [option for name in COMMANDS for option in command_options(name).values()
                if option.flag == words[0]]
        kinds = {value for option in near for value in get_args(option.kinds[0])}
        assert set(words[1].split("|")) <= kinds, f"{words[0]} takes no {words[1]}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_prose_mentions_is_there(page: Path) -> None:
    for span in spans(page):
        mentioned(span)


@pytest.mark.parametrize("span", ["--colour", "part2gs-robot fix", "--preset best",
                                  "part2gs-robot export TWIN --kind usd", "--no-parts"])
def test_a_planted_mention_is_found(span: str) -> None:
    with pytest.raises(AssertionError):
        mentioned(span)


@pytest.fixture(scope="module")
def folder(ball_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with what commands on pages name: a scene, and a twin with a door."""
    path = tmp_path_factory.mktemp("user")
    api.write_twin(handled_twin(), path / "out")
    shutil.copytree(ball_scene, path / "scene")
    shutil.copytree(path / "out", path / "twins/one")
    return path


def test_exceptions_are_commands() -> None:
    assert set(NOT_RUN) < set(COMMANDS)


@pytest.mark.parametrize("line", sorted({
    shlex.join(words[1:]) for _, line in commands(OURS) for words in calls(line)
    if words[0] == OURS and words[1] not in NOT_RUN}))
def test_a_quick_command_runs(line: str, folder: Path, monkeypatch, capsys) -> None:
    if "usd" in line:
        pytest.importorskip("pxr")
    monkeypatch.chdir(folder)
    words = [name for word in shlex.split(line)
             for name in (sorted(map(str, folder.glob(word))) if "*" in word else [word])]
    assert cli.main(words) == 0, capsys.readouterr().err


@pytest.mark.parametrize("page", [p for p in PAGES if fenced(p.read_text(), "python")],
                         ids=lambda page: page.name)
def test_python_on_a_page_runs(page: Path, folder: Path, monkeypatch) -> None:
    monkeypatch.chdir(folder)
    names: dict[str, object] = {}
    for code in fenced(page.read_text(), "python"):
        exec(compile(code, page.name, "exec"), names)


def test_settings_on_the_page_of_scenes_are_settings() -> None:
    texts = fenced((ROOT / "docs/scene.md").read_text(), "yaml")
    assert texts
    for text in texts:
        resolve({}, yaml.safe_load(text), "scene.md")
