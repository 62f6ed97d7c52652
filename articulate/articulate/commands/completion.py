"""Completion scripts for shells, with every command, flag, setting and choice."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Any

from articulate.commands.fields import Flag, flag_docs, flags_of
from articulate.errors import UsageError, nearest

SHELLS = ("bash", "zsh", "fish")
COMMON = ("--config", "--set", "--quiet", "--verbose", "--help", "--help-all")
SHORT = {
    "check-asset": "check",
    "train": "train",
    "evaluate": "evaluate",
    "export-policy": "export",
    "deploy": "deploy",
}
"""Installed scripts that are short for a command of ``articulate``."""


@dataclass(frozen=True)
class Words:
    """Words that can follow a command."""

    flags: dict[str, str]
    """Flags with their documentation."""
    choices: dict[str, tuple[str, ...]]
    """Values of flags with few; those of positional arguments have the key ``""``."""


def words_of(cls: type[Any]) -> Words:
    """Return the words that can follow a command with the flags ``cls``."""
    docs, flags = flag_docs(cls), list(flags_of(cls))
    named = [flag for flag in flags if not flag.positional and not flag.is_nested]
    loose = [choice for flag in flags if flag.positional for choice in flag.choices]
    choices = {flag.name: flag.choices for flag in named if flag.choices}
    keys = tuple(f"{flag.key}=" for flag in flags if flag.is_nested)
    choices |= {"--set": keys} if keys else {}
    return Words(
        flags={_flag_text(f): docs.get(f.path, "") for f in named} | dict.fromkeys(COMMON, ""),
        choices=choices | ({"": tuple(loose)} if loose else {}),
    )


def verb_words(entry: EntryPoint) -> Words:
    """Return the words that can follow the command ``entry``, from ``FLAGS`` in its module.

    A command that cannot be imported, or has no ``FLAGS``, has the common flags only.
    """
    try:
        cls = importlib.import_module(entry.module).FLAGS
    except (ImportError, AttributeError):
        return Words(flags=dict.fromkeys(COMMON, ""), choices={})
    return words_of(cls)


def script(shell: str, verbs: Mapping[str, Words]) -> str:
    """Return the completion script of ``shell`` for ``articulate`` and its short names.

    Raises:
        UsageError: ``shell`` is not in :data:`SHELLS`.
    """
    if shell not in SHELLS:
        raise UsageError(f"--completion {shell}: unknown shell{nearest(shell, SHELLS)}")
    return {"bash": _bash, "zsh": _zsh, "fish": _fish}[shell](verbs)


def _flag_text(flag: Flag) -> str:
    switched_on = flag.is_switch and flag.default is True
    return f"--no-{flag.name.removeprefix('--')}" if switched_on else flag.name


_BASH = """\
_articulate() {{
    local cur=${{COMP_WORDS[COMP_CWORD]}} prev=${{COMP_WORDS[COMP_CWORD-1]}} verb words
    case ${{COMP_WORDS[0]##*/}} in
{short}
        *) verb=${{COMP_WORDS[1]}} ;;
    esac
    if [[ $COMP_CWORD -eq 1 && ${{COMP_WORDS[0]##*/}} == articulate ]]; then
        COMPREPLY=($(compgen -W "{verbs} --help --version --completion" -- "$cur"))
        return
    fi
    case "$verb $prev" in
{choices}
    esac
    if [[ -z $words && $cur == -* ]]; then
        case $verb in
{flags}
        esac
    fi
    if [[ $prev == --set ]]; then compopt -o nospace 2>/dev/null; fi
    if [[ -n $words ]]; then
        COMPREPLY=($(compgen -W "$words" -- "$cur"))
    else
        COMPREPLY=($(compgen -f -- "$cur"))
    fi
}}
complete -o filenames -F _articulate articulate {names}
"""


def _bash(verbs: Mapping[str, Words]) -> str:
    choices, flags = [], []
    for verb, words in verbs.items():
        for flag, values in words.choices.items():
            if flag:
                choices.append(f'        "{verb} {flag}") words="{" ".join(values)}" ;;')
        flags.append(f'            {verb}) words="{" ".join(words.flags)}" ;;')
        if "" in words.choices:
            loose = " ".join(words.choices[""])
            choices.append(f'        "{verb} {verb}") words="{loose}" ;;')
    return _BASH.format(
        short="\n".join(f"        {name}) verb={verb} ;;" for name, verb in SHORT.items()),
        verbs=" ".join(verbs),
        choices="\n".join(choices),
        flags="\n".join(flags),
        names=" ".join(SHORT),
    )


def _zsh(verbs: Mapping[str, Words]) -> str:
    """Return the script of bash, which zsh can run."""
    return "autoload -U +X bashcompinit && bashcompinit\n" + _bash(verbs)


def _fish(verbs: Mapping[str, Words]) -> str:
    lines = [f"complete -c articulate -n __fish_use_subcommand -a '{' '.join(verbs)}'"]
    for verb, words in verbs.items():
        short = [name for name, of in SHORT.items() if of == verb]
        starts = [f"complete -c articulate -n '__fish_seen_subcommand_from {verb}'"]
        starts += [f"complete -c {name}" for name in short]
        for start in starts:
            for flag, text in words.flags.items():
                values = words.choices.get(flag)
                more = f" -x -a '{' '.join(values)}'" if values else ""
                doc = text.replace("\\", "\\\\").replace("'", "\\'")
                lines.append(f"{start} -l {flag.removeprefix('--')}{more} -d '{doc}'")
            if "" in words.choices:
                lines.append(f"{start} -a '{' '.join(words.choices[''])}'")
    return "\n".join(lines) + "\n"
