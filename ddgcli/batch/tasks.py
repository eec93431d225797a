"""Tasks of a batch: every input with every combination of swept parameters."""

from __future__ import annotations

import glob
import itertools
import shlex
import string
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ddgcli.errors import ParameterError

FIELDS = ("stem", "name", "suffix", "index")
GLOB_CHARACTERS = frozenset("*?[")


@dataclass(frozen=True)
class Task:
    """One run.

    Parameters
    ----------
    index : int
        Number of the task in the whole batch, from 0.
    input : str
    parameters : dict of str to str
        Swept option names (without dashes) and their values.
    output : str or None
    words : tuple of str
        Command line behind `ddgcli`.
    """

    index: int
    input: str
    parameters: dict[str, str]
    output: str | None
    words: tuple[str, ...]

    @property
    def command(self) -> str:
        """Command line of the task, by which a resumed batch recognises it."""
        return shlex.join(["ddgcli", *self.words])

    def in_existing_folder(self) -> Task:
        """The task with its output in a folder that exists: a run makes the folder, a dry run does not."""
        if self.output is None or Path(self.output).parent.is_dir():
            return self
        target = Path(self.output)
        folder = next(parent for parent in target.parents if parent.is_dir())
        output = str(folder / f"dry-run-{target.name}")  # not the name of an input
        return replace(self, output=output, words=(*self.words[:-1], output))


def expanded_inputs(patterns: Sequence[str]) -> list[str]:
    """Files that paths and patterns such as `meshes/*.ply` name, each once, in order.

    Parameters
    ----------
    patterns : sequence of str

    Returns
    -------
    list of str

    Raises
    ------
    ParameterError
        A pattern matches nothing.
    """
    inputs: dict[str, None] = {}
    for pattern in patterns:
        if Path(pattern).exists() or not GLOB_CHARACTERS & set(pattern):
            inputs[pattern] = None
            continue
        matches = sorted(path for path in glob.glob(pattern, recursive=True) if Path(path).is_file())
        if not matches:
            raise ParameterError(f"no file matches {pattern!r}; name existing files", parameter="inputs")
        inputs |= dict.fromkeys(matches)
    return list(inputs)


def parsed_sweeps(sweeps: Sequence[str]) -> dict[str, list[str]]:
    """Values by option name from texts `NAME=V1,V2`.

    Parameters
    ----------
    sweeps : sequence of str

    Returns
    -------
    dict of str to list of str

    Raises
    ------
    ParameterError
        For a text of another form, or a name that occurs twice.
    """
    values: dict[str, list[str]] = {}
    for sweep in sweeps:
        name, equals, text = sweep.partition("=")
        name = name.lstrip("-").replace("_", "-")
        if not name or not equals or not all(text.split(",")):
            raise ParameterError(f"{sweep!r} is not NAME=V1,V2,...", parameter="sweep")
        if name in values:
            raise ParameterError(f"{name} is swept twice; give all its values at once", parameter="sweep")
        values[name] = text.split(",")
    return values


def make_tasks(
    inputs: Sequence[str], sweeps: Mapping[str, Sequence[str]], template: str | None, command: Sequence[str]
) -> list[Task]:
    """Tasks in the order of inputs, then of swept values.

    Parameters
    ----------
    inputs : sequence of str
    sweeps : mapping of option name to values
    template : str or None
        Path of the outputs with `{stem}`, `{name}`, `{suffix}`, `{index}` and swept names.
    command : sequence of str
        Command and its options, such as `["curvature", "--scheme", "corrected"]`.

    Returns
    -------
    list of Task

    Raises
    ------
    ParameterError
        The template has an unknown field, or gives two tasks one path.
    """
    _check_template(template, sweeps)
    tasks: list[Task] = []
    owner: dict[str, str] = {}
    for index, (path, parameters) in enumerate(_combinations(inputs, sweeps)):
        output = _formatted(template, path, index, parameters) if template is not None else None
        if output is not None and owner.setdefault(output, path) is not path:
            raise ParameterError(
                f"{owner[output]} and {path} would both be written to {output}; add {{index}} or {{name}}",
                parameter="output",
            )
        words = [command[0], path, *command[1:]]
        words += [word for name, value in parameters.items() for word in (f"--{name}", value)]
        words += ["-o", output] if output is not None else []
        tasks.append(Task(index, path, dict(parameters), output, tuple(words)))
    outputs = [task.output for task in tasks if task.output is not None]
    if len(set(outputs)) < len(outputs):
        raise ParameterError("several swept values would be written to one path; add their names in braces",
                             parameter="output")  # fmt: skip
    return tasks


def _combinations(
    inputs: Sequence[str], sweeps: Mapping[str, Sequence[str]]
) -> Iterator[tuple[str, dict[str, str]]]:
    for path in inputs:
        for values in itertools.product(*sweeps.values()):
            yield path, dict(zip(sweeps, values))


def _check_template(template: str | None, sweeps: Mapping[str, Any]) -> None:
    if template is None:
        return
    try:
        fields = [field for _, field, _, _ in string.Formatter().parse(template) if field is not None]
    except ValueError as error:
        raise ParameterError(f"{template!r}: {error}; write a brace as {{{{", parameter="output") from error
    names = [*FIELDS, *sweeps]
    unknown = [field for field in fields if field not in names]
    if unknown:
        raise ParameterError(
            f"{template!r}: unknown field {{{unknown[0]}}}; known: {', '.join(names)}", parameter="output"
        )


def _formatted(template: str, path: str, index: int, parameters: Mapping[str, str]) -> str:
    place = Path(path)
    fields = {"stem": place.stem, "name": place.name, "suffix": place.suffix.lstrip("."), "index": str(index)}
    return "".join(
        text + ({**fields, **parameters}[field] if field is not None else "")
        for text, field, _, _ in string.Formatter().parse(template)
    )


def shard_of(tasks: Sequence[Task], shard: str | None) -> list[Task]:
    """Every N-th task of a batch.

    Parameters
    ----------
    tasks : sequence of Task
    shard : str or None
        `I/N` with I from 1 to N; None for all tasks.

    Returns
    -------
    list of Task

    Raises
    ------
    ParameterError
        For a text of another form.
    """
    if shard is None:
        return list(tasks)
    number, _, count = shard.partition("/")
    if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise ParameterError(f"{shard!r} is not I/N with I from 1 to N", parameter="shard")
    return [task for task in tasks if task.index % int(count) == int(number) - 1]
