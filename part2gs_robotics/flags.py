"""Command line built from the settings: every field of a room is a flag, its string the help."""

from __future__ import annotations

import argparse
import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal, NoReturn, cast, get_args, get_origin

from part2gs_robotics import __version__
from part2gs_robotics.config import PRESETS, Option, Value, convert, options
from part2gs_robotics.errors import ConfigError

Place = Literal["local", "ray", "slurm"]
Told = Literal["text", "json", "junit", "sarif", "github", "html"]
Format = Literal["mjcf", "urdf", "usd", "sdf", "glb", "ros"]


@dataclass(frozen=True)
class Command:
    """A sub-command.

    Attributes:
        summary: first line of its help.
        paths: names of the paths it takes.
        rooms: rooms of the configuration whose flags it uses.
        extra: further flags: name -> setting of its own.
        instead: names of other paths it takes as well.
        many: any number of the path it takes.
        examples: words behind the program's name, and what they do, for its help.
    """

    summary: str
    paths: tuple[str, ...]
    rooms: tuple[str, ...]
    extra: tuple[Option, ...] = ()
    instead: tuple[str, ...] = ()
    examples: tuple[str, ...] = ()
    many: bool = False

    @property
    def shown(self) -> str:
        """The paths as help shows them."""
        if self.many:
            return f"{self.paths[0]}..."
        return " | ".join(" ".join(names) for names in (self.paths, self.instead) if names)


def _capture(name: str, kind: type, default: Value, doc: str) -> Option:
    return Option(name, ("capture",), (kind,), default, doc)


def _check(name: str, kind: type, default: Value, doc: str) -> Option:
    return Option(name, ("check",), (kind,), default, doc)


# What each command does, its paths, the rooms whose settings it takes, and flags of its own.
COMMANDS = {
    "build": Command("two-state photos in, MuJoCo-checked twin out", ("SCENE",),
                     ("photos", "read", "fit", "stereo", "search", "articulate", "mesh", "texture",
                      "check", "output"), instead=("PHOTOS_0", "PHOTOS_1"), examples=(
                         "build scene/ -o out/                 a scene with cameras and masks",
                         "build closed/ open/ -o out/          plain photos; videos do as well",
                         "build scene/ -o out/ --preset draft  a quick look",
                         "build scene/ --parts 3 --known-length 1.8 --material hardwood")),
    "batch": Command("many scenes to many twins, on this machine, on Ray or on SLURM", ("SCENE",),
                     ("read", "fit", "stereo", "search", "articulate", "mesh", "texture", "check",
                      "output"),
                     (Option("out", ("batch",), (str,), "twins", "folder of the twins"),
                      Option("on", ("batch",), (Place,), "local", "where: threads of this machine, "
                             "a Ray cluster (RAY_ADDRESS, else one here), or SLURM"),
                      Option("workers", ("batch",), (int,), 1, "builds at a time on this machine"),
                      Option("retries", ("batch",), (int,), 2, "tries more for a build that was "
                             "killed or broke; a refused scene is not tried again")),
                     many=True, examples=("batch scenes/*/ -o twins/ --preset draft",
                                          "batch scenes/*/ -o twins/ --on ray --workers 8")),
    "check": Command("the simulator checks alone, on twin folders, MJCF, URDF or USD files",
                     ("PATH",), ("check",),
                     (Option("format", ("check",), (Told,), "text",
                             "how to say it: for people, programs or CI"),
                      _check("samples", int, 0, "draws of the joints from their standard "
                             "deviations: how likely they are free of collision"),
                      _check("stress", bool, False,
                             "also what takes long: extremes, error against run time, ten seconds "
                             "of rest, slow drives"),
                      _check("apply", bool, False, "with --stress: write the advised time step and "
                             "integrator into scene.xml"),
                      _check("root", str, None,
                             "folder that nothing a model names may leave; default: its own"),
                      _check("jobs", int, 0, "assets at a time; 0 = one a core"),
                      _check("cache", str, None, "folder of earlier results, by content"),
                      _check("disable", list, None, "id of a check whose failures do not count, "
                             "and why; may be given several times"),
                      _check("baseline", str, None, "file of known failures, which do not count"),
                      _check("write_baseline", bool, False, "write what fails into --baseline")),
                     many=True, examples=("check out/", "check twins/* --format junit > checks.xml",
                                          "check twins/* --cache .checks --samples 100",
                                          "check ros/door/urdf/door.urdf --root ros/")),
    "explain": Command("what a check of `check` looks at, its threshold, what mends it", ("ID",),
                       (), examples=("explain overlap",)),
    "export": Command("write a twin folder's twin as MJCF, URDF, USD, SDFormat, glTF or for ROS 2",
                      ("TWIN",), (),
                      (Option("format", ("export",), (Format,), None,
                              "what to write; must be given"),
                       Option("out", ("export",), (str,), None,
                              "folder of the new files; default: TWIN/FORMAT")),
                      examples=("export out/ --format usd", "export out/ --format ros -o pkg/")),
    "view": Command("move a finished twin by hand in the browser, MuJoCo behind it", ("TWIN",), (),
                    (Option("port", ("view",), (int,), 8080,
                            "of the page on 127.0.0.1; the next free one where it is taken"),),
                    examples=("view out/",)),
    "scene": Command("plain photos or videos of two states in, a scene for build out",
                     ("PHOTOS_0", "PHOTOS_1"), ("photos",),
                     (Option("out", ("scene",), (str,), "scene", "folder of the new scene"),
                      Option("known_length", ("scene",), (float,), None, "metres of the object's "
                             "longest side, where no marker is seen")),
                     examples=("scene closed/ open/ -o scene/", "scene closed.mp4 open.mp4")),
    "marker": Command("write a sheet of markers to print: it gives photos their scale", (), (),
                      (Option("out", ("marker",), (str,), "sheet.pdf", "the new file"),
                       Option("charuco", ("marker",), (bool,), False,
                              "a ChArUco board of 3 x 4 squares instead of 6 ArUco markers")),
                      examples=("marker -o sheet.pdf", "marker --charuco -o board.pdf")),
    "inspect": Command("say in seconds what a scene holds and what would make it better",
                       ("SCENE",), ("read",), examples=("inspect scene/",)),
    "doctor": Command("what this machine has of what is needed, and what to do", (), (),
                      examples=("doctor", "doctor --json")),
    "completion": Command("completion of commands and flags for bash, zsh or fish", ("SHELL",), (),
                          examples=('completion bash   in ~/.bashrc: eval "$(part2gs-robot '
                                    'completion bash)"',)),
    "capture": Command("render a two-state scene with ground truth from an MJCF or URDF model",
                       ("MODEL", "SCENE"), (),
                       (_capture("views", int, 64, "training views per state"),
                        _capture("test_views", int, 0,
                                 "further views per state that no fit may use"),
                        _capture("size", int, 400, "image side in pixels"),
                        _capture("seed", int, 0, "places of the cameras"),
                        _capture("depth", bool, False, "also write 16-bit depth images"),
                        _capture("state", list, None, "positions of one joint in both states; may "
                                 "be given for several joints, all others stay at rest")),
                       examples=("capture door.xml scene/ --views 64 --state hinge=0,1.2",)),
}
ALWAYS = ("quiet", "verbose", "json")
WORDS = {"state": "JOINT=Q0,Q1", "disable": "ID=REASON"}  # of flags that may be given again
SHORT = {"out": ["-o"], "scale": ["--meters-per-unit"]}  # further spellings
FIRST_EXAMPLES = (
    "build closed/ open/ -o out/   photos of an object closed and open, to a twin in MuJoCo",
    "build scene/ -o out/          the same from photos with cameras and masks",
    "build --help                  all flags of a command",
    "doctor                        what this machine lacks, and what to do")
EXIT_CODES = """exit codes: 0 built and all checks pass; 1 built or checked, but physics fails
or what moved is not all explained; 2 bad usage or input; 3 internal error;
130 interrupted (the same command continues)"""


@dataclass(frozen=True)
class Call:
    """A parsed command line: command, its paths, and the settings that were given."""

    command: str
    paths: tuple[str, ...]
    flags: dict[str, Value]


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Raise instead of printing usage: every error takes one way out."""
        raise ConfigError(f"command line: {message}. Expected {self.usage}; see --help.")


def parse(argv: Sequence[str]) -> Call:
    """Return the parsed command line; flags may stand anywhere.

    Raises:
        ConfigError: unknown command or flag, wrong number of paths, or a value that does not fit.
        SystemExit: after --help or --version.
    """
    name = next((word for word in argv if word in COMMANDS), "")
    found, unknown = _parser(name).parse_known_intermixed_args(list(argv))
    given = vars(found)
    words = cast("list[str]", given.pop("words"))
    if not words or words[0] not in COMMANDS:
        raise ConfigError(f"command line: no command ({' '.join(words)[:60] or 'empty'}). Expected "
                          f"one of {', '.join(COMMANDS)}; for example: part2gs-robot build scene/.")
    command, paths = words[0], tuple(words[1:])
    available, wanted = command_options(command), COMMANDS[command]
    if unknown:
        _refuse_unknown(unknown[0], command, available)
    right = {len(wanted.paths), len(wanted.instead or wanted.paths)}
    if not (paths if wanted.many else len(paths) in right):
        raise ConfigError(f"command line: {command} got {len(paths)} paths. Expected "
                          f"{wanted.shown}; see part2gs-robot {command} --help.")
    return Call(command, paths, {key: convert(available[key], value, available[key].flag)
                                 for key, value in given.items()})


def command_options(name: str) -> dict[str, Option]:
    """Return the settings one command uses, by name."""
    command = COMMANDS[name]
    found = {key: option for key, option in options().items()
             if set(option.rooms) & set(command.rooms) or key in ALWAYS}
    return found | {option.name: option for option in command.extra}


def _parser(name: str) -> _Parser:
    listing = "\n".join(f"  {key:10s} {' '.join(command.paths):17s}  {command.summary}"
                        for key, command in COMMANDS.items())
    shown = COMMANDS[name].examples if name else FIRST_EXAMPLES
    examples = "examples:\n" + "\n".join(f"  part2gs-robot {words}" for words in shown)
    paths = COMMANDS[name].shown if name else "PATH..."
    parser = _Parser(
        prog="part2gs-robot", allow_abbrev=False,
        usage=f"part2gs-robot {name or 'COMMAND'} {paths} [flags in any order]",
        description=f"{examples}\n\ncommands:\n{listing}", epilog=EXIT_CODES,
        argument_default=argparse.SUPPRESS,  # what was not given must not override scene.yaml
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*", default=[], help=argparse.SUPPRESS)
    parser.add_argument("--version", action="version", version=f"part2gs-robot {__version__}")
    settings = command_options(name).values() if name else ()
    for room, members in groupby(settings, lambda option: option.rooms[0]):
        group = parser.add_argument_group(room)
        for option in members:
            _add_flag(group, option)
    return parser


def _add_flag(group: argparse._ArgumentGroup, option: Option) -> None:
    names = [option.flag, *SHORT.get(option.name, [])]
    shown = "" if option.default is None else f" (default: {_shown(option.default)})"
    text = f"{option.doc}{shown}".replace("%", "%%")
    kind = option.kinds[0]
    values = "|".join(map(str, get_args(kind))) or option.name.upper()
    if kind is bool:
        group.add_argument(*names, action=argparse.BooleanOptionalAction, help=text)
    elif get_origin(kind) is tuple:
        group.add_argument(*names, type=_number, nargs=3, metavar=("X", "Y", "Z"), help=text)
    elif kind is list:
        group.add_argument(*names, action="append", metavar=WORDS[option.name], help=text)
    else:
        number = kind in (int, float)
        group.add_argument(*names, type=_number if number else str, metavar=values, help=text)


def _shown(value: Value) -> str:
    return {True: "on", False: "off"}[value] if isinstance(value, bool) else str(value)


def _number(text: str) -> object:
    """Return text as int or float where it is one, so that `convert` judges it like YAML."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _refuse_unknown(word: str, command: str, available: dict[str, Option]) -> NoReturn:
    flags = [option.flag for option in available.values()]
    elsewhere = [key for key in COMMANDS
                 if word in [option.flag for option in command_options(key).values()]]
    if elsewhere:
        raise ConfigError(f"command line: {command} does not use {word}. Expected flags of "
                          f"{command}; {word} belongs to {', '.join(elsewhere)}.")
    near = difflib.get_close_matches(word, flags, n=1, cutoff=0.0)[0]
    raise ConfigError(f"command line: unknown flag {word[:60]}. Nearest valid flag: {near}; see "
                      f"part2gs-robot {command} --help for all {len(flags)}. Presets: "
                      f"{', '.join(PRESETS)}.")
