"""doctor, completion, JSON: what programs and shells read is what the commands have."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from part2gs_robotics import cli
from part2gs_robotics.commands import doctor
from part2gs_robotics.commands.completion import script
from part2gs_robotics.errors import ConfigError
from part2gs_robotics.flags import COMMANDS, command_options


def text_of(shell, capsys):
    assert cli.main(["completion", shell]) == 0
    return capsys.readouterr().out


def completed(text: str, *words: str) -> list[str]:
    """Return what bash offers for the last of the words."""
    line = " ".join(f"'{word}'" for word in ("part2gs-robot", *words))
    run = (f"{text}\nCOMP_WORDS=({line}); COMP_CWORD={len(words)}; _part2gs_robot\n"
           'printf "%s\\n" "${COMPREPLY[@]}"')
    return subprocess.run(["bash", "-c", run], capture_output=True, text=True,
                          check=True).stdout.split()


def test_bash_completes_commands_flags_and_values(capsys):
    text = text_of("bash", capsys)
    assert set(completed(text, "")) == {*COMMANDS, "--help", "--version"}
    assert completed(text, "bu") == ["build"]
    assert completed(text, "build", "--pre") == ["--preset"]
    assert set(completed(text, "build", "scene", "--preset", "")) == {"draft", "standard", "high"}
    assert completed(text, "build", "--no-dep") == ["--no-depth"]
    assert completed(text, "check", "--form") == ["--format"]
    assert completed(text, "marker", "--pre") == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_flag_of_every_command_is_completed(shell, capsys):
    text = text_of(shell, capsys)
    for name in COMMANDS:
        for option in command_options(name).values():
            assert option.flag.removeprefix("--") in text
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=text, text=True, check=True)


def test_another_shell_is_refused():
    with pytest.raises(ConfigError, match=r"'tcsh' is not known\. Expected one of bash, zsh, fish"):
        script("tcsh", {}, {})


def test_doctor_finds_what_is_there(capsys):
    code = cli.main(["doctor", "--json"])
    found = json.loads(capsys.readouterr().out)
    by_name = {one["name"]: one for one in found["findings"]}
    for name in ("python", "torch", "mujoco", "threads", "memory", "disk here", "libGL",
                 "extra photos"):
        assert name in by_name
    assert by_name["mujoco"]["status"] == "ok"
    assert code == int(not found["ok"])
    assert cli.main(["doctor"]) == code
    assert "mujoco" in capsys.readouterr().out


def test_doctor_names_what_lacks_and_what_to_do(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(doctor, "version", lambda name: (_ for _ in ()).throw(
        doctor.PackageNotFoundError(name)))
    monkeypatch.setattr(doctor, "NEEDED_BYTES", 1 << 62)
    monkeypatch.setattr(doctor.ctypes.util, "find_library", lambda name: None)
    monkeypatch.setattr(doctor, "DRAW", "raise SystemExit('no EGL')")
    text = doctor.told(doctor.examine(tmp_path))
    for line in ("MISSING numpy", "pip install 'numpy'", "free some space", "no EGL",
                 "apt-get install libgl1", "pip install 'part2gs-robotics[photos]'",
                 "things missing"):
        assert line in text
    assert cli.main(["doctor"]) == 1


@pytest.mark.parametrize("words", [
    ["explain", "overlap"], ["marker", "-o", "{}/a.pdf"], ["inspect", "{scene}"],
    ["completion", "bash"], ["check", "{}/nothing"], ["build", "{}/nothing"]])
def test_json_is_one_object(words, ball_scene, tmp_path, capsys):
    code = cli.main([word.format(tmp_path, scene=ball_scene) for word in words] + ["--json"])
    found = json.loads(capsys.readouterr().out)
    assert isinstance(found, dict)
    assert (code == 2) == ("error" in found)


def test_ctrl_c_says_the_command_that_goes_on(monkeypatch, capsys):
    def stopped(call):
        raise KeyboardInterrupt

    monkeypatch.setitem(cli.RUN, "build", stopped)
    assert cli.main(["build", "my scene", "-o", "out"]) == 130
    assert "  part2gs-robot build 'my scene' -o out\n" in capsys.readouterr().err


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_examples_that_parse(name, capsys):
    import shlex

    from part2gs_robotics.flags import parse

    assert COMMANDS[name].examples
    for text in COMMANDS[name].examples:
        words = shlex.split(text.split("   ")[0].split("  ")[0].split(" > ")[0])
        assert parse(words).command == name
