"""Messages of a run on standard error: warnings of the core, and the line of an error."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from ddgcli.cli.parameters import error_text, with_option_names, with_repair_command
from ddgcli.errors import DdgError, MissingExtraError, OutputError

WARNINGS_OF_A_KIND = 3  # kept of those that differ in numbers only, such as those of the steps of a run


class MessageHandler(logging.Handler):
    """Collect warnings of the core for the summary; with -v print all its messages at once.

    A logged error is the reason why a run failed and yet has results: it is among the warnings of the
    summary, and printed after them, with -q too.

    A warning of one row (`row_label` of the record) that was also given for the whole input is left out.
    If warnings differ only in numbers, the first `WARNINGS_OF_A_KIND` are kept and the others counted;
    of rows the first, with the names of all its rows.

    Parameters
    ----------
    verbose : int
    quiet : bool
    options : mapping of str to str
        Option of each parameter name.
    """

    def __init__(self, verbose: int, quiet: bool, options: Mapping[str, str]) -> None:
        super().__init__(logging.DEBUG if verbose > 1 else logging.INFO if verbose else logging.WARNING)
        self._warnings: dict[str, str] = {}  # kind of each text
        self._errors: set[str] = set()
        self._counts: Counter[str] = Counter()
        self._rows: dict[str, dict[str, str]] = {}  # of each kind of warnings of rows: text by label
        self.options = options
        self.verbose, self.quiet = verbose, quiet

    def emit(self, record: logging.LogRecord) -> None:
        context = click.get_current_context(silent=True)
        message = with_option_names(record.getMessage(), self.options)
        message = with_repair_of_input(message, {} if context is None else context.meta)
        if record.levelno >= logging.WARNING and record.name != "py.warnings":
            label = getattr(record, "row_label", "")
            if label:
                self._collect_of_row(message.removeprefix(f"{label}: "), label)
            elif message not in self._warnings:
                self._collect(message, kind=_without_numbers(message))
            if record.levelno >= logging.ERROR:
                self._errors.add(message)
            message = self._line(message)
        if self.verbose and not self.quiet:
            click.echo(message, err=True)

    def _line(self, message: str) -> str:
        return f"{'Error' if message in self._errors else 'Warning'}: {message}"

    def _collect(self, message: str, kind: str) -> None:
        self._counts[kind] += 1
        if self._counts[kind] <= WARNINGS_OF_A_KIND:
            self._warnings[message] = kind

    def _collect_of_row(self, text: str, label: str) -> None:
        kind = f"row: {_without_numbers(text)}"
        if kind in self._rows:
            self._rows[kind].setdefault(label, text)
        elif text not in self._warnings:
            self._rows[kind] = {label: text}
            self._warnings[f"{label}: {text}"] = kind

    def warnings(self) -> list[str]:
        """The warnings so far; the last kept one of a kind states how many more there were."""
        last = {kind: message for message, kind in self._warnings.items()}
        return [
            _of_rows(self._rows[kind])
            if kind in self._rows
            else message + (self._more(kind) if message == last[kind] else "")
            for message, kind in self._warnings.items()
        ]

    def _more(self, kind: str) -> str:
        more = self._counts[kind] - WARNINGS_OF_A_KIND
        return f" ({more} more such warning{'s' * (more > 1)} with other numbers)" if more > 0 else ""

    def install(self) -> None:
        """Become the only handler of the core's messages and of Python's warnings."""
        for name in ("ddgcli", "py.warnings"):
            logger = logging.getLogger(name)
            logger.handlers[:] = [self]
            logger.setLevel(self.level if name == "ddgcli" else logging.ERROR)
            logger.propagate = False
        if not self.verbose:  # of folders that it cannot write, such as that of its fonts
            logging.getLogger("matplotlib").setLevel(logging.ERROR)
        if self.verbose > 1:
            logging.getLogger("py.warnings").setLevel(logging.WARNING)
        logging.captureWarnings(True)

    def print_warnings(self) -> None:
        """Print the collected warnings at the end, so that a run with an error prints one line only."""
        for message in sorted(self.warnings(), key=self._errors.__contains__):
            if not self.verbose and (not self.quiet or message in self._errors):
                click.echo(self._line(message), err=True)


def _of_rows(texts: Mapping[str, str]) -> str:
    """One warning of several rows, with the numbers of the first."""
    first = next(iter(texts))
    differ = len(set(texts.values())) > 1
    return f"{', '.join(texts)}: {texts[first]}" + (f" (the numbers are of {first})" if differ else "")


def _without_numbers(message: str) -> str:
    """The text with one sign for every number; the numbers in names, as of an object `s1`, stay."""
    return re.sub(r"(?<![\w.])\d[\d.,]*(?:e[+-]?\d+)?(?!\w)", "#", message)


def path_from_here(path: str) -> str:
    """A path inside the working folder without that folder."""
    place, here = Path(path), Path.cwd()
    return str(place.relative_to(here) if place.is_relative_to(here) else place)


def with_repair_of_input(message: str, meta: Mapping[str, Any]) -> str:
    """The message with the repair that it names as a command on the input mesh of a run, from its context."""
    holds_tetrahedra = meta.get("ddgcli.tetrahedra", False)
    return with_repair_command(message, _read_words(meta), tetrahedra=holds_tetrahedra)


def _read_words(meta: Mapping[str, Any], path: str = "") -> tuple[str, ...]:
    """Words that read the input mesh of a run, or the mesh of this path."""
    return path or meta.get("ddgcli.mesh", "MESH"), *meta.get("ddgcli.read_options", ())


def error_line(error: DdgError, context: click.Context) -> str:
    """Message of an error with option names and, if it names no file, after the name of the input."""
    message = error_text(error, context.meta.get("ddgcli.options", {}))
    mesh, meta = getattr(error, "mesh", None), context.meta
    if mesh:
        message = with_repair_command(message, _read_words(meta, path_from_here(mesh)))
    else:
        message = with_repair_of_input(message, meta)
    path = context.meta.get("ddgcli.input")
    if path and not isinstance(error, (OutputError, MissingExtraError)) and not message.startswith(path):
        return f"{path}: {message}"
    return message
