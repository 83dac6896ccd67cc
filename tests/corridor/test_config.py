"""Settings: one name everywhere, later wins, every value judged before it is used."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields

import pytest

from part2gs_robotics.config import (
    BOUNDS,
    PRESETS,
    Config,
    Value,
    convert,
    options,
    resolve,
    to_dict,
)
from part2gs_robotics.errors import ConfigError


def test_every_room_is_small_and_every_field_documented() -> None:
    for room in fields(Config):
        assert len(fields(getattr(Config(), room.name))) <= 12
    for option in options().values():
        assert option.doc


def test_presets_and_bounds_name_settings() -> None:
    known = options()
    assert set(BOUNDS) <= set(known)
    for preset in PRESETS.values():
        for name, value in preset.items():
            assert convert(known[name], value, name) == value


def test_defaults_are_within_their_own_rules() -> None:
    for option in options().values():
        assert convert(option, option.default, option.flag) == option.default or \
            option.default is None


def test_every_number_is_bounded() -> None:
    numbers = {name for name, option in options().items() if option.kinds[0] in (int, float)}
    assert numbers == set(BOUNDS)


def test_flags_win_over_scene_yaml_and_that_over_presets() -> None:
    assert resolve({"preset": "draft"}).fit.steps == PRESETS["draft"]["steps"]
    assert resolve({}, {"preset": "draft", "steps": 77}).fit.steps == 77
    assert resolve({"steps": 88}, {"preset": "draft", "steps": 77}).fit.steps == 88
    assert resolve({"preset": "standard"}, {"preset": "draft"}) == Config()


def test_one_seed_reaches_every_room() -> None:
    config = resolve({"seed": 11})
    assert config.fit.seed == config.articulate.seed == 11


def test_keys_may_be_spelled_as_flags() -> None:
    assert resolve({}, {"max-side": 300}).read.max_side == 300


@pytest.mark.parametrize(("key", "nearest"), [("partz", "parts"), ("max_sides", "max_side"),
                                              ("UP", "up"), (3, "")])
def test_unknown_key_names_the_nearest(key: object, nearest: str) -> None:
    with pytest.raises(ConfigError, match=f"Nearest valid name: '{nearest}"):
        resolve({}, {key: 1})


@pytest.mark.parametrize(("name", "value"), [
    ("parts", 0), ("parts", 65), ("parts", 1.0), ("parts", True), ("parts", "2"), ("parts", [2]),
    ("up", [0, 0]), ("up", [0, 0, 0]), ("up", [0, 0, float("nan")]), ("up", "z"),
    ("up", [0, 0, True]), ("scale", 0), ("scale", float("inf")),
    ("known_length", 10**400), ("material", "cheese"), ("material", True), ("material", 0),
    ("depth", 1), ("depth", "yes"), ("preset", "best"),
    ("preset", ["draft"]), ("seed", -1), ("seed", None), ("out", ""), ("max_side", {}),
])
def test_wrong_values_are_refused(name: str, value: object) -> None:
    with pytest.raises(ConfigError, match=f"scene.yaml: {name} is .*Expected .*Change the value"):
        resolve({}, {name: value})


@pytest.mark.parametrize(("name", "value", "want"), [
    ("parts", None, None), ("up", [0, 1, 0], (0.0, 1.0, 0.0)), ("scale", 1, 1.0),
    ("material", 712, "712"), ("material", "steel", "steel"),
    ("depth", False, False), ("preset", "high", "high"),
])
def test_right_values_are_converted(name: str, value: object, want: Value) -> None:
    assert convert(options()[name], value, "scene.yaml") == want


def test_plain_data_holds_every_setting() -> None:
    plain = to_dict(resolve({"up": (0.0, 0.0, 1.0), "parts": 2}))
    assert set(plain) == {room.name for room in fields(Config)}
    read = plain["read"]
    assert isinstance(read, dict)
    assert read["up"] == [0.0, 0.0, 1.0]


def test_settings_load_nothing_heavy() -> None:
    code = ("import sys, part2gs_robotics.config, part2gs_robotics.flags, part2gs_robotics.cli\n"
            "heavy = {'numpy', 'torch', 'numba', 'mujoco', 'cv2', 'scipy', 'yaml'}\n"
            "sys.exit(', '.join(heavy & set(sys.modules)) or 0)")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_scale_keeps_its_earlier_name_and_is_said_once() -> None:
    assert resolve({}, {"meters_per_unit": 0.5}).read.scale == 0.5
    assert resolve({"scale": 2.0}, {"meters_per_unit": 0.5}).read.scale == 2.0
    with pytest.raises(ConfigError, match=r"scale is 2\.0 and known_length is 1\.8"):
        resolve({"known_length": 1.8}, {"scale": 2.0})
