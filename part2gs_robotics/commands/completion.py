"""Shell completion: commands, flags and their values, as a script without further programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import get_args

from part2gs_robotics.config import Option
from part2gs_robotics.errors import ConfigError

PROGRAM = "part2gs-robot"
Flags = Mapping[str, Sequence[Option]]  # by command


def script(shell: str, flags: Flags, summaries: Mapping[str, str]) -> str:
    """Return the text that a shell reads.

    Args:
        shell: bash, zsh or fish.
        flags: of every command.
        summaries: what every command does.

    Raises:
        ConfigError: another shell.
    """
    writers = {"bash": _bash, "zsh": _zsh, "fish": _fish}
    if shell not in writers:
        raise ConfigError(f"completion: shell {shell[:40]!r} is not known. Expected one of "
                          f"{', '.join(writers)}; for example: {PROGRAM} completion bash.")
    return writers[shell](flags, summaries)


def _words(option: Option) -> list[str]:
    return [option.flag, *([f"--no-{option.flag[2:]}"] if option.kinds[0] is bool else [])]


def _values(option: Option) -> list[str]:
    return [str(value) for value in get_args(option.kinds[0]) if isinstance(value, str)]


def _chosen(flags: Flags) -> dict[str, list[str]]:
    """Return flags that take one of a few words, with these."""
    return {option.flag: _values(option) for options in flags.values() for option in options
            if _values(option)}


def _bash(flags: Flags, summaries: Mapping[str, str]) -> str:
    cases = "".join(f"    {flag}) COMPREPLY=($(compgen -W '{' '.join(values)}' -- \"$cur\")); "
                    "return;;\n" for flag, values in _chosen(flags).items())
    own = ""
    for name, options in flags.items():
        words = [word for option in options for word in _words(option)]
        own += f"    {name}) words='{' '.join(words)} --help';;\n"
    return f"""# eval "$({PROGRAM} completion bash)", in ~/.bashrc
_part2gs_robot() {{
  local cur="${{COMP_WORDS[COMP_CWORD]}}" prev="${{COMP_WORDS[COMP_CWORD-1]}}" words=''
  case "$prev" in
{cases}  esac
  if [ "$COMP_CWORD" = 1 ]; then
    COMPREPLY=($(compgen -W '{' '.join(summaries)} --help --version' -- "$cur")); return
  fi
  case "${{COMP_WORDS[1]}}" in
{own}  esac
  case "$cur" in -*) COMPREPLY=($(compgen -W "$words" -- "$cur"));; esac
}}
complete -o default -F _part2gs_robot {PROGRAM}
"""


def _zsh(flags: Flags, summaries: Mapping[str, str]) -> str:
    names = " ".join(f"'{name}:{text.replace(chr(39), '')}'" for name, text in summaries.items())
    own = []
    for name, options in flags.items():
        shown = []
        for option in options:
            doc = option.doc.replace("'", "").replace("[", "(").replace("]", ")").replace(":", ",")
            action = f":value:({' '.join(_values(option))})" if _values(option) else (
                "" if option.kinds[0] is bool else ":value:_files")
            shown += [f"'{word}[{doc}]{action}'" for word in _words(option)]
        own.append(f"    {name}) _arguments {' '.join(shown)} '*:path:_files';;\n")
    return f"""#compdef {PROGRAM}
# eval "$({PROGRAM} completion zsh)", in ~/.zshrc after compinit
_part2gs_robot() {{
  if (( CURRENT == 2 )); then
    local -a names=({names})
    _describe command names; return
  fi
  case "$words[2]" in
{"".join(own)}  esac
}}
compdef _part2gs_robot {PROGRAM}
"""


def _fish(flags: Flags, summaries: Mapping[str, str]) -> str:
    first = f"complete -c {PROGRAM} -n __fish_use_subcommand -f"
    lines = [f"# {PROGRAM} completion fish > ~/.config/fish/completions/{PROGRAM}.fish\n"]
    for name, text in summaries.items():
        lines.append(f"{first} -a {name} -d '{text.replace(chr(39), '')}'\n")
    for name, options in flags.items():
        for option in options:
            choice = f" -xa '{' '.join(_values(option))}'" if _values(option) else ""
            for word in _words(option):
                lines.append(f"complete -c {PROGRAM} -n '__fish_seen_subcommand_from {name}' "
                             f"-l {word[2:]} -d '{option.doc.replace(chr(39), '')}'{choice}\n")
    return "".join(lines)
