"""Tasks of a batch: every input with every combination of swept parameters."""

from __future__ import annotations

import glob
import itertools
import os
import re
import shlex
import string
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ddgcli.errors import ParameterError

FIELDS = ("stem", "name", "suffix", "index")
FIELD_IN_WORD = re.compile(r"\{([a-z-]+)\}")
OUTPUT_OPTIONS = ("-o", "--output")
GLOB_CHARACTERS = frozenset("*?[")


@dataclass(frozen=True)
class Task:
    """One run.

    Parameters
    ----------
    index : int
        Index of the task in the whole batch, from 0.
    input : str
    parameters : dict of str to str
        Swept option names (without dashes) and their values.
    output : str or None
    words : tuple of str
        Command line after `ddgcli`.
    output_places : tuple of int
        Where the words name files to write.
    """

    index: int
    input: str
    parameters: dict[str, str]
    output: str | None
    words: tuple[str, ...]
    output_places: tuple[int, ...] = ()

    @property
    def command(self) -> str:
        """Command line of the task, by which a resumed batch recognises it."""
        return shlex.join(["ddgcli", *self.words])

    @property
    def output_files(self) -> list[Path]:
        """Files that the command line names for output."""
        return [Path(self.words[place]) for place in self.output_places]

    def make_folders(self) -> None:
        """Make the folders of the files to write."""
        for path in self.output_files:
            path.parent.mkdir(parents=True, exist_ok=True)

    def in_existing_folders(self) -> Task:
        """The task with its outputs in folders that exist: a run makes the folders, a dry run does not."""
        words = list(self.words)
        for place, target in zip(self.output_places, self.output_files):
            if not target.parent.is_dir():
                folder = next(parent for parent in target.parents if parent.is_dir())
                words[place] = str(folder / f"dry-run-{target.name}")  # not the name of an input
        output = words[-1] if self.output is not None else None
        return replace(self, output=output, words=tuple(words))


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
        For a text of another form, or a name or a value that occurs twice.
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
        if len(set(values[name])) < len(values[name]):
            raise ParameterError(f"{sweep!r} has a value twice; leave one out", parameter="sweep")
    return values


def make_tasks(
    inputs: Sequence[str],
    sweeps: Mapping[str, Sequence[str]],
    template: str | None,
    command: Sequence[str],
    output_options: Collection[str] = OUTPUT_OPTIONS,
) -> list[Task]:
    """Tasks in the order of inputs, then of swept values.

    Parameters
    ----------
    inputs : sequence of str
    sweeps : mapping of option name to values
    template : str or None
        Path of the outputs with `{stem}`, `{name}`, `{suffix}`, `{index}` and swept names.
    command : sequence of str
        Command and its options, such as `["curvature", "--scheme", "corrected"]`, with the same fields.
    output_options : collection of str
        Options of the command that name files to write.

    Returns
    -------
    list of Task

    Raises
    ------
    ParameterError
        The template has an unknown field, or two tasks have one output.
    """
    _check_template(template, sweeps)
    tasks: list[Task] = []
    owner: dict[str, Task] = {}
    for index, (path, parameters) in enumerate(_combinations(inputs, sweeps)):
        fields = _fields(path, index, parameters)
        output = _formatted(template, fields) if template is not None else None
        place = f"./{path}" if path.startswith("-") and path != "-" else path  # which would be an option
        words = [command[0], place, *(_with_fields(word, fields) for word in command[1:])]
        words += [word for name, value in parameters.items() for word in (f"--{name}", value)]
        words += ["-o", output] if output is not None else []
        words, places = _output_places(words, output_options)
        task = Task(index, path, dict(parameters), output, tuple(words), places)
        for file in (words[k] for k in places):
            if (other := owner.setdefault(_file_name(file), task)) is not task:
                raise _shared_output_error(other, task, file)
        tasks.append(task)
    return tasks


def refuse_inputs_as_outputs(tasks: Sequence[Task], table: str | None = None) -> None:
    """Raise an error if a run would write an input, its own or that of another run, or the table.

    Parameters
    ----------
    tasks : sequence of Task
        All of the batch.
    table : str, optional
        Path of the table of the batch.

    Raises
    ------
    ParameterError
    """
    inputs = {_file_key(Path(task.input)): task.input for task in tasks}
    inputs.pop(None, None)  # of those that do not exist
    for task in tasks:
        for path in task.output_files:
            owner = inputs.get(_file_key(path))
            if owner == task.input:
                reason = "is the input itself"
            elif owner is not None:
                reason = f"is the input of another run, and that of {task.input} would write it"
            elif table is not None and os.path.abspath(path) == os.path.abspath(table):
                reason = "is the table of the batch too"
            else:
                continue
            raise ParameterError(f"{path}: {reason}; write to another file", parameter="output")
    if table is not None and _file_key(Path(table)) in inputs:
        raise ParameterError(f"{table}: is an input; write to another file", parameter="table")


def _file_key(path: Path) -> tuple[int, int] | None:
    """Key that is equal for two names of the same file; None if the file does not exist."""
    try:
        facts = path.stat()
    except (OSError, ValueError):
        return None
    return facts.st_dev, facts.st_ino


def _output_places(
    words: Sequence[str], output_options: Collection[str]
) -> tuple[list[str], tuple[int, ...]]:
    """The words of a command line with options and their files apart, and where files to write are named."""
    apart: list[str] = []
    for word in words:
        name, equals, path = word.partition("=")
        apart += [name, path] if equals and name in output_options else [word]
    pairs = enumerate(itertools.pairwise(apart), start=1)
    return apart, tuple(k for k, (word, following) in pairs if word in output_options and following != "-")


def _file_name(path: str) -> str:
    """What equals for two paths of one file: Windows and macOS ignore the case of letters."""
    return path.casefold() if sys.platform in ("win32", "darwin") else path


def _shared_output_error(first: Task, second: Task, output: str) -> ParameterError:
    """Error of two tasks that would write one file, with the fields in which they differ."""
    own, other = (_fields(task.input, task.index, task.parameters) for task in (first, second))
    names = (*first.parameters, "stem", "name", "index")
    differ = [name for name in names if _file_name(own[name]) != _file_name(other[name])]
    remedies = " or ".join(f"{{{name}}}" for name in differ)
    if first.input == second.input:
        return ParameterError(
            f"several swept values would be written to one path, {output}; add {remedies}", parameter="output"
        )
    return ParameterError(
        f"{first.input} and {second.input} would both be written to {output}; add {remedies}",
        parameter="output",
    )


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


def _fields(path: str, index: int, parameters: Mapping[str, str]) -> dict[str, str]:
    """Values of the fields of a task by name."""
    place = Path(path)
    own = {"stem": place.stem, "name": place.name, "suffix": place.suffix.lstrip("."), "index": str(index)}
    return {**own, **parameters}


def _formatted(template: str, fields: Mapping[str, str]) -> str:
    return "".join(
        text + (fields[field] if field is not None else "")
        for text, field, _, _ in string.Formatter().parse(template)
    )


def _with_fields(word: str, fields: Mapping[str, str]) -> str:
    """A word of the command with its fields replaced; other braces stay, as in f_{:04d}.ply."""
    return FIELD_IN_WORD.sub(lambda match: fields.get(match[1], match[0]), word)


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
