"""Several values after one option: `--source 0 5 12` is `--source 0 --source 5 --source 12`."""

from __future__ import annotations

import re

import click

_NUMBER = re.compile(r"[-+]?(\d|\.\d)")
_SEPARATORS = ",:="


def repeat_options(command: click.Command, words: list[str]) -> list[str]:
    """Words of a call with a repeatable option repeated before each of its values.

    A word is a further value if it is no option, the option's type accepts it, and (for text) it has the
    separators of the value before it: a file name after `--source 0` remains an argument.
    """
    repeatable = {
        name: option
        for option in command.params
        if isinstance(option, click.Option) and option.multiple and option.nargs == 1
        for name in option.opts
    }
    may_lack_value = {
        name
        for option in command.params
        if isinstance(option, click.Option) and not option.is_flag and isinstance(option.flag_value, str)
        for name in option.opts
    }
    result: list[str] = []
    current, before = "", ""
    waiting = False
    for position, word in enumerate(words):
        if word == "--":
            return result + words[position:]
        if result and result[-1] in may_lack_value and word.startswith("-") and _NUMBER.match(word):
            word = " " + word  # click reads a negative number there as an option
        if waiting:
            waiting, before = False, word
        elif word in repeatable:
            current, waiting = word, True
        elif current and _further_value(repeatable[current], word, before):
            result.append(current)
        else:
            current = ""
        result.append(word)
    return result


def _further_value(option: click.Option, word: str, before: str) -> bool:
    if word.startswith("-") and not _NUMBER.match(word):
        return False
    if isinstance(option.type, click.types.StringParamType):
        shape = [c for c in before if c in _SEPARATORS]
        return bool(shape) and [c for c in word if c in _SEPARATORS] == shape
    if isinstance(option.type, click.Path):
        return False
    try:
        option.type.convert(word, option, None)
    except (click.UsageError, ValueError):
        return False
    return True
