"""Remedies that an error names, applied to the call: options to add, replace or omit, or a repair."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from random import Random

import click

from benchmarks.fuzz.call_options import MEASURES, SIMULATIONS, Place, command_of, option_words

OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
ADVICE = re.compile(
    r"(use|or|e\.g\.|add|give|needs) (--[a-z][a-z-]+)(?: ((?!or\b|and\b|to\b|is\b|for\b)[\w.:=-]+))?"
)
REPAIR = re.compile(r"ddgcli repair (?:[^;]|;(?! ))*?-o (?:\S+-)?repaired\.(?:ply|vtu)")
DROPS = re.compile(
    r"leave (?:it|them|this|that|one|--[a-z-]+) out|leave out|(?<!-)drop\b|exclude each other"
    r"|give one|keep one"
)
LEAVE = re.compile(r"(?:leave|drop) (--[a-z-]+(?:(?:, | and | or )--[a-z-]+)*)")
ADDS = re.compile(r"add |give that|give it|give both|needs? ")


@dataclass(frozen=True)
class Remedy:
    """What a refusal names, and the words of the call that follows it.

    Parameters
    ----------
    reason : str
    words : list of str
    before : list of str
        A call that runs first: a repair.
    """

    reason: str
    words: list[str]
    before: tuple[str, ...] = ()


def subject_of(words: list[str]) -> str:
    """The command whose options the words are: the inner one of a comparison."""
    inner = [word for word in words[1:] if word in (*MEASURES, *SIMULATIONS)]
    return inner[0] if words[0] in ("tradeoff", "batch", "check") and inner else words[0]


def spans(words: list[str], command: click.Command) -> list[tuple[str, int, int]]:
    """Options in the words: long name, first word, end."""
    by_word = {word: o for o in command.params if isinstance(o, click.Option)
               for word in (*o.opts, *o.secondary_opts)}  # fmt: skip
    result, k = [], 1
    while k < len(words):
        option = by_word.get(words[k])
        if option is None:
            k += 1
            continue
        end = k + 1 + (0 if option.is_flag or option.count else option.nargs)
        if option.metavar and option.metavar.startswith("[") and end <= len(words):
            end -= end - 1 < len(words) and words[end - 1].startswith("-") or end - 1 >= len(words)
        result.append((max(option.opts, key=len), k, min(end, len(words))))
        k = max(end, k + 1)
    return result


def without(words: list[str], command: click.Command, *names: str) -> list[str]:
    """The words without some options and their values."""
    indices = {k for name, first, end in spans(words, command) if name in names for k in range(first, end)}
    return [word for k, word in enumerate(words) if k not in indices]


def remedies(words: list[str], message: str, place: Place, mesh_name: str) -> Iterator[Remedy]:
    """The remedies of a refusal, those that its text is surest about first."""
    command = command_of(subject_of(words))
    options = {o.opts[-1] if o.opts[-1].startswith("--") else max(o.opts, key=len): o
             for o in command.params if isinstance(o, click.Option)}  # fmt: skip
    present = {name for name, _, _ in spans(words, command)}
    for match in REPAIR.finditer(message):
        repair = shlex.split(match.group(0))[1:]
        output = "{folder}/" + repair[-1].rpartition("-")[2]
        if repair[1] == mesh_name:
            mesh_word = "{input}" if "{input}" in words else f"{{folder}}/{mesh_name}"
            if mesh_word == output:  # a second repair
                output = f"{{folder}}/twice_{mesh_name}"
            before = ("repair", mesh_word, *repair[2:-1], output)
            superfluous = OPTION.findall(" ".join(LEAVE.findall(message[match.end() :])))
            rest = without(words, command, *superfluous)
            yield Remedy("repair", [output if word == mesh_word else word for word in rest], before)
            return
        if words[1] == "-":  # the message names what standard input holds MESH
            before = ("repair", "-", *repair[2:-1], output)
            yield Remedy("repair", [words[0], output, *without(words, command, "--input-format")[2:]], before)
            return
    head, _, tail = re.sub(r": (?=use --)", "; ", message).rpartition("; ")
    superfluous = [name for group in LEAVE.findall(tail) for name in OPTION.findall(group) if name in present]
    if superfluous:
        rest = without(words, command, *superfluous)
        advice = [(name, value) for _, name, value in ADVICE.findall(tail) if name in options and value][:1]
        for name, value in advice:
            rest = [*without(rest, command, name), name, value]
        yield Remedy(f"without {' '.join(superfluous)}", rest)
        return
    for _, name, value in ADVICE.findall(tail):
        if name in options and not options[name].is_flag and value:
            yield Remedy(f"{name} {value}", [*without(words, command, name), name, value])
        elif name in options and name not in present:
            yield Remedy(f"with {name}", [*words, *option_words(options[name], place)])
    if suffixes := re.findall(r"(?<!\S)\.[a-z0-9]+", head) if "with -o" in tail else []:
        yield Remedy(
            f"-o {suffixes[0]}", [*words, "-o", place.output("outputs").partition(".")[0] + suffixes[0]]
        )
    mentioned = list(dict.fromkeys(name for name in OPTION.findall(message) if name in options))
    if drop := DROPS.search(tail):
        here = [name for name in OPTION.findall(tail) if name in present] or mentioned
        if " them " in drop.group(0):
            yield Remedy(f"without {' '.join(here)}", without(words, command, *here))
            return
        for name in here[:1] if " it" in drop.group(0) else here:
            if name in present:
                yield Remedy(f"without {name}", without(words, command, name))
    elif ADDS.search(tail):
        for name in mentioned:
            if name not in present:
                yield Remedy(f"with {name}", [*words, *option_words(options[name], place)])


def place_of(rng: Random, words: list[str], mesh: dict) -> Place:
    """The place of the values of options that a remedy adds."""
    place = Place(rng, subject_of(words), mesh)
    place.outputs = 50  # names of files that no earlier option has
    return place
