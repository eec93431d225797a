"""Print the summary: text for people, or one strict JSON object."""

from __future__ import annotations

import json
import math
import textwrap
from typing import Any

import click

from ddgcli.cli.short_summary import short_body

LINE_WIDTH = 100  # characters
SHORT_LIST = 12  # entries of a list in a short summary
SHORT_ROWS = 6  # rows of a table, or outputs, in a short summary


def plain(value: Any, missing: list[str] | None = None, name: str = "") -> Any:
    """Value as numbers, lists and dicts of strict JSON; numbers that are not finite become null.

    `missing` collects the dotted names of the nulls.
    """
    if hasattr(value, "tolist"):  # numpy scalars and arrays, without importing numpy here
        value = value.tolist()
    if isinstance(value, dict):
        return {str(k): plain(v, missing, f"{name}.{k}" if name else str(k)) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v, missing, f"{name}[{i}]") for i, v in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        if missing is not None:
            missing.append(name)
        return None
    if isinstance(value, complex):
        return plain([value.real, value.imag], missing, name)
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return str(value)


def print_summary(
    summary: dict[str, Any],
    as_json: bool,
    err: bool = False,
    text: list[str] | None = None,
    *,
    full: bool = False,
) -> None:
    """Print the summary on standard output, or with `err` on standard error; by default its short fields."""
    if as_json:
        click.echo(json.dumps(summary, allow_nan=False, ensure_ascii=False))
        return
    shown, hidden = (summary, 0) if full else short_body(summary)
    lines = _lines(shown, text, full)
    if hidden and text is None:
        lines.append("more fields by --full")
    click.echo("\n".join(lines), err=err)


def _lines(summary: dict[str, Any], text: list[str] | None, full: bool) -> list[str]:
    called = (summary["command"], summary["options"].get("compared"), summary["input"].get("path"))
    lines = [" ".join(word for word in called if word)]
    for section in ("input", "results", "accuracy"):
        shown = {k: v for k, v in summary[section].items() if k != "path"}
        if section == "results" and text is not None:
            lines += [section, *(f"  {line}".rstrip() for line in text)]
        elif section == "input" and shown and not full:
            lines += _wrapped("input  ", ", ".join(f"{k} {_text(v)}" for k, v in shown.items()))
        elif shown:
            lines += [section, *block_lines(shown, "  ", full)]
    seconds = summary["seconds"]
    part_names = seconds if full else ["start", "total"]
    lines.append("seconds  " + ", ".join(f"{k} {seconds[k]:.3g}" for k in part_names))
    outputs = summary["outputs"] if full else _shortened(summary["outputs"])
    return lines + [f"wrote  {path}" for path in outputs]


def _shortened(rows: list[str]) -> list[str]:
    """The first SHORT_ROWS rows, and how many there are."""
    return rows if len(rows) <= SHORT_ROWS + 1 else [*rows[:SHORT_ROWS], f"... ({len(rows)} by --full)"]


def block_lines(values: dict[str, Any], indent: str, full: bool) -> list[str]:
    """Lines of names and values, those of a nested block indented further."""
    width = max((len(k) for k, v in values.items() if not _nested(v)), default=0)
    lines = []
    for name, value in values.items():
        if isinstance(value, dict) and _nested(value):
            lines += [f"{indent}{name}", *block_lines(value, indent + "  ", full)]
        elif _nested(value):
            shown = [_text(row) for row in value]
            rows = shown if full else _shortened(shown)
            lines += [f"{indent}{name}", *(line for row in rows for line in _wrapped(indent + "  ", row))]
        else:
            lines += _wrapped(f"{indent}{name:<{width}}  ", _listed(value, full))
    return lines


def _wrapped(head: str, text: str) -> list[str]:
    """Text behind a head, in lines of LINE_WIDTH characters."""
    lines = textwrap.wrap(
        text, max(LINE_WIDTH - len(head), 40), break_long_words=False, break_on_hyphens=False
    )
    return [head + lines[0], *(" " * len(head) + line for line in lines[1:])] if lines else [head.rstrip()]


def _nested(value: Any) -> bool:
    if isinstance(value, dict):
        long = any(isinstance(v, str) and len(v) > 30 for v in value.values())
        return len(value) > 3 or long or any(isinstance(v, (dict, list)) for v in value.values())
    return isinstance(value, list) and any(isinstance(v, dict) for v in value)


def _listed(value: Any, full: bool) -> str:
    """A value; of a long list the first SHORT_LIST entries and the last, unless `full`."""
    if not isinstance(value, list) or full or len(value) <= SHORT_LIST + 1:
        return _text(value)
    first = ", ".join(_text(v) for v in value[:SHORT_LIST])
    return f"[{first}, ..., {_text(value[-1])}] ({len(value)} values)"


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return ", ".join(f"{k} {_text(v)}" for k, v in value.items()) or "none"
    if isinstance(value, list):
        return f"[{', '.join(_text(v) for v in value)}]"
    return "none" if value is None else str(value)
