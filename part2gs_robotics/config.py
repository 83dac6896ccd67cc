"""Settings: one frozen dataclass per room, presets, and values judged before they are used.

Flags, keys of scene.yaml and fields share one name. Later wins: preset, scene.yaml, flags.
"""

from __future__ import annotations

import ast
import difflib
import inspect
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from types import MappingProxyType
from typing import Literal, cast, get_args, get_origin, get_type_hints

from part2gs_robotics.config_rooms import (
    ArticulateConfig,
    CheckConfig,
    FitConfig,
    Material,
    MeshConfig,
    OutputConfig,
    PhotosConfig,
    ReadConfig,
    SearchConfig,
    StereoConfig,
    TextureConfig,
)
from part2gs_robotics.errors import ConfigError
from part2gs_robotics.model.materials import HEAVIEST, LIGHTEST, MATERIALS, density_of

__all__ = [
    "BOUNDS", "PRESETS", "ArticulateConfig", "CheckConfig", "Config", "FitConfig", "MeshConfig",
    "Option", "OutputConfig", "PhotosConfig", "ReadConfig", "SearchConfig", "StereoConfig",
    "TextureConfig", "Value", "convert", "options", "resolve", "to_dict", "with_values",
]  # fmt: skip

Value = bool | int | float | str | tuple[float, float, float] | tuple[str, ...] | None


@dataclass(frozen=True)
class Config:
    """Everything `build` can be told, one member per room."""

    photos: PhotosConfig = field(default_factory=PhotosConfig)
    read: ReadConfig = field(default_factory=ReadConfig)
    fit: FitConfig = field(default_factory=FitConfig)
    stereo: StereoConfig = field(default_factory=StereoConfig)
    search: SearchConfig = field(default_factory=SearchConfig)
    articulate: ArticulateConfig = field(default_factory=ArticulateConfig)
    mesh: MeshConfig = field(default_factory=MeshConfig)
    texture: TextureConfig = field(default_factory=TextureConfig)
    check: CheckConfig = field(default_factory=CheckConfig)
    output: OutputConfig = field(default_factory=OutputConfig)


PRESETS: dict[str, dict[str, Value]] = {  # standard is what the dataclasses say
    "draft": {"max_side": 320, "steps": 640, "half_steps": 300, "start_gaussians": 9_000,
              "max_gaussians": 14_000, "hull_resolution": 128, "view_color": False,
              "proof_side": 128, "align_views": 8, "align_side": 160, "sharp_side": 256,
              "contact": False, "vector_field": False, "resolution": 96, "sweep_values": 11},
    "standard": {},
    "high": {"max_side": 1024, "steps": 3000, "half_steps": 600, "start_gaussians": 25_000,
             "max_gaussians": 80_000, "hull_resolution": 256, "resolution": 256,
             "sweep_values": 41},
}

# smallest and largest value that can mean anything; outside it is a typing mistake
BOUNDS: dict[str, tuple[float, float]] = {
    # below 400 pixels features are too few; above 4096, 80 photos need more than 2 GB; fewer frames
    # than `build` needs are none, and matching does 300 in some minutes
    "side": (400, 4096), "frames": (20, 300), "marker_size": (1e-4, 10.0),
    "max_side": (32, 8192), "scale": (1e-9, 1e9), "known_length": (1e-9, 1e9),
    "steps": (1, 1_000_000),
    "half_steps": (0, 1_000_000), "start_gaussians": (100, 10_000_000),
    "max_gaussians": (100, 10_000_000), "hull_resolution": (16, 1024), "alpha_weight": (0, 1e3),
    "opacity_weight": (0, 1e3), "depth_weight": (0, 1e3), "smooth_weight": (0, 1e3),
    "stereo_views": (3, 10_000), "stereo_side": (16, 1024), "surfel_size": (1e-3, 0.1),
    "patches": (2, 1000), "patch_points": (12, 1000), "proof_views": (2, 1000),
    "proof_side": (16, 2048), "align_views": (2, 1000), "align_side": (16, 4096),
    "sharp_side": (16, 4096), "parts": (1, 64), "resolution": (16, 1024),
    "clearance_voxels": (0, 16), "collision_gap": (0, 0.05), "texture_side": (64, 8192),
    "sweep_values": (3, 10_001), "seed": (0, 2**31 - 1),
}

ALIASES = {"meters_per_unit": "scale"}  # earlier names of settings, still understood


@dataclass(frozen=True)
class Option:
    """One setting as flags and scene.yaml see it."""

    name: str
    rooms: tuple[str, ...]
    kinds: tuple[object, ...]
    default: Value
    doc: str

    @property
    def flag(self) -> str:
        """Spelling on the command line."""
        return "--" + self.name.replace("_", "-")


@cache  # reads the rooms' source: 14 ms, and a command asks several times
def options() -> Mapping[str, Option]:
    """Return every setting by name, in the order of the rooms."""
    found: dict[str, Option] = {}
    for room, room_type in get_type_hints(Config).items():
        hints, docs = get_type_hints(room_type), _field_docs(room_type)
        for item in fields(room_type):
            rooms = (*(found[item.name].rooms if item.name in found else ()), room)
            hint = hints[item.name]
            kinds = get_args(hint) if type(None) in get_args(hint) else (hint,)
            found[item.name] = Option(item.name, rooms, kinds, cast(Value, item.default),
                                      docs[item.name])
    return MappingProxyType(found)


def _field_docs(room_type: type[object]) -> dict[str, str]:
    body = cast(ast.ClassDef, ast.parse(inspect.getsource(room_type)).body[0]).body
    docs: dict[str, str] = {}
    for node, text in itertools.pairwise(body):
        if isinstance(node, ast.AnnAssign) and isinstance(text, ast.Expr):
            name, value = cast(ast.Name, node.target), cast(ast.Constant, text.value)
            docs[name.id] = str(value.value)
    return docs


def resolve(flags: dict[str, Value], scene_yaml: dict[object, object] | None = None,
            where: str = "scene.yaml") -> Config:
    """Return the configuration: preset, overridden by scene.yaml, overridden by flags.

    Args:
        flags: settings given on the command line, by field name.
        scene_yaml: parsed mapping of scene.yaml.
        where: name of that file for messages.

    Raises:
        ConfigError: unknown key, wrong type, value out of bounds, or two scales.
    """
    known = options()
    from_yaml = {_known_name(key, known, where): value for key, value in (scene_yaml or {}).items()}
    checked = {name: convert(known[name], value, where) for name, value in from_yaml.items()}
    for given, value in flags.items():
        name = _known_name(given, known, "settings")
        checked[name] = convert(known[name], value, known[name].flag)
    preset = str(checked.get("preset", "standard"))
    if None not in (checked.get("scale"), checked.get("known_length")):
        raise ConfigError(f"{where} and flags: scale is {checked['scale']} and known_length is "
                          f"{checked['known_length']}. Expected one of them, since either says how "
                          "long a unit is; leave the other out.")
    return with_values(Config(), PRESETS[preset] | checked)


def with_values(config: Config, values: dict[str, Value]) -> Config:
    """Return `config` with settings replaced by name, in every room that has them."""
    known = options()
    for room in fields(Config):
        mine = {name: value for name, value in values.items() if room.name in known[name].rooms}
        member = replace(getattr(config, room.name), **mine)
        config = replace(config, **{room.name: member})
    return config


def _known_name(key: object, known: Mapping[str, Option], where: str) -> str:
    name = str(key).replace("-", "_")
    name = ALIASES.get(name, name)
    if name in known:
        return name
    near = difflib.get_close_matches(name.lower(), known, n=1, cutoff=0.0)
    raise ConfigError(f"{where}: unknown key {str(key)[:60]!r}. Nearest valid name: {near[0]!r}; "
                      f"valid names are {', '.join(sorted(known))}. Rename or remove the key.")


def convert(option: Option, value: object, where: str) -> Value:
    """Return `value` as the setting's type, inside its bounds.

    Raises:
        ConfigError: naming the setting, the value and what was expected.
    """
    if value is None and type(None) in option.kinds:
        return None
    kind = option.kinds[0]
    good, expected = _convert(kind, value)
    low, high = BOUNDS.get(option.name, (-math.inf, math.inf))
    if isinstance(good, int | float) and not isinstance(good, bool) and not low <= good <= high:
        good, expected = None, f"{expected} from {low:g} to {high:g}"
    if good is None:
        shown = repr(value)[:60]
        place = f"{where}: {option.name}" if where != option.flag else option.flag
        raise ConfigError(f"{place} is {shown}. Expected {expected} ({option.doc}). "
                          "Change the value or leave it out.")
    return good


def _convert(kind: object, value: object) -> tuple[Value, str]:
    """Return (converted value or None when it does not fit, what was expected)."""
    if get_origin(kind) is Literal:
        return (cast(str, value) if value in get_args(kind) else None,
                "one of " + ", ".join(map(str, get_args(kind))))
    if kind is bool:
        return value if isinstance(value, bool) else None, "true or false"
    if kind is int:
        whole = isinstance(value, int) and not isinstance(value, bool)
        return cast(int, value) if whole else None, "a whole number"
    if kind is float:
        return _finite(value), "a number"
    if kind is str:
        return value if isinstance(value, str) and value else None, "text"
    if kind is Material:
        known = str(value) if density_of(str(value)) is not None else None
        return (known if not isinstance(value, bool) else None,
                f"kg/m3 from {LIGHTEST:g} to {HEAVIEST:g}, or one of {', '.join(MATERIALS)}")
    if kind is list:
        return tuple(map(str, value)) if isinstance(value, list) else None, "words"
    parts = [_finite(v) for v in value] if isinstance(value, list | tuple) else []
    if len(parts) == 3 and None not in parts and any(parts):
        x, y, z = cast(list[float], parts)
        return (x, y, z), ""
    return None, "three numbers, not all zero"


def _finite(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def to_dict(config: object) -> dict[str, object]:
    """Return the configuration as nested plain data for config.yaml and for hashing."""
    return {item.name: _plain(getattr(config, item.name))
            for item in fields(config)}  # type: ignore[arg-type]  # any of the dataclasses above


def _plain(value: object) -> object:
    if is_dataclass(value):
        return to_dict(value)
    return list(value) if isinstance(value, tuple) else value
