"""Completion for shells: scripts with every verb, flag and choice, made from the flags' classes."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Any

from articulate.commands.fields import Flag, flag_docs, flags_of
from articulate.errors import UsageError, nearest

SHELLS = ("bash", "zsh", "fish")
COMMON = ("--config", "--quiet", "--verbose", "--help")
SHORT = {
    "check-asset": "check",
    "train": "train",
    "evaluate": "evaluate",
    "export-policy": "export",
    "deploy": "deploy",
}
"""Installed names that are short for a verb."""


@dataclass(frozen=True)
class Words:
    """What can follow a verb."""

    flags: dict[str, str]
    """Flags, and what is said of them."""
    choices: dict[str, tuple[str, ...]]
    """Values of flags that have few; those of arguments without a name below ``""``."""


def words_of(cls: type[Any]) -> Words:
    """What can follow a verb with the flags ``cls``."""
    docs, flags = flag_docs(cls), list(flags_of(cls))
    named = [flag for flag in flags if not flag.positional]
    loose = [choice for flag in flags if flag.positional for choice in flag.choices]
    choices = {flag.name: flag.choices for flag in named if flag.choices}
    return Words(
        flags={_shown(f): docs.get(f.path, "") for f in named} | dict.fromkeys(COMMON, ""),
        choices=choices | ({"": tuple(loose)} if loose else {}),
    )


def verb_words(entry: EntryPoint) -> Words:
    """What can follow the verb ``entry``, whose module says so in ``FLAGS``.

    A verb that cannot be imported, or does not say it, offers the common flags.
    """
    try:
        cls = importlib.import_module(entry.module).FLAGS
    except (ImportError, AttributeError):
        return Words(flags=dict.fromkeys(COMMON, ""), choices={})
    return words_of(cls)


def script(shell: str, verbs: Mapping[str, Words]) -> str:
    """A script that teaches ``shell`` what follows ``articulate`` and its short names.

    Raises:
        UsageError: It is none of :data:`SHELLS`.
    """
    if shell not in SHELLS:
        raise UsageError(f"--completion {shell}: unknown shell{nearest(shell, SHELLS)}")
    return {"bash": _bash, "zsh": _zsh, "fish": _fish}[shell](verbs)


def _shown(flag: Flag) -> str:
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
    """Zsh runs bash's completions once it is told to."""
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
                said = text.replace("\\", "\\\\").replace("'", "\\'")
                lines.append(f"{start} -l {flag.removeprefix('--')}{more} -d '{said}'")
            if "" in words.choices:
                lines.append(f"{start} -a '{' '.join(words.choices[''])}'")
    return "\n".join(lines) + "\n"
