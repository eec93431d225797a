"""Print the summary: text for people, or one strict JSON object."""

from __future__ import annotations

import json
import math
from typing import Any

import click


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
    summary: dict[str, Any], as_json: bool, err: bool = False, text: list[str] | None = None
) -> None:
    """Print the summary on standard output, or with `err` on standard error."""
    if as_json:
        click.echo(json.dumps(summary, allow_nan=False, ensure_ascii=False))
        return
    click.echo("\n".join(_lines(summary, text)), err=err)


def _lines(summary: dict[str, Any], text: list[str] | None = None) -> list[str]:
    called = (summary["command"], summary["options"].get("compared"), summary["input"].get("path"))
    lines = [" ".join(word for word in called if word)]
    for section in ("input", "results", "accuracy"):
        shown = {k: v for k, v in summary[section].items() if k != "path"}
        if section == "results" and text is not None:
            lines += [section, *(f"  {line}".rstrip() for line in text)]
        elif shown:
            lines += [section, *_block(shown, "  ")]
    seconds = summary["seconds"]
    lines.append("seconds  " + ", ".join(f"{k} {seconds[k]:.3g}" for k in seconds))
    return lines + [f"wrote  {path}" for path in summary["outputs"]]


def _block(values: dict[str, Any], indent: str) -> list[str]:
    width = max((len(k) for k, v in values.items() if not _nested(v)), default=0)
    lines = []
    for name, value in values.items():
        if isinstance(value, dict) and _nested(value):
            lines += [f"{indent}{name}", *_block(value, indent + "  ")]
        elif _nested(value):
            lines += [f"{indent}{name}", *(f"{indent}  {_text(row)}" for row in value)]
        else:
            lines.append(f"{indent}{name:<{width}}  {_text(value)}")
    return lines


def _nested(value: Any) -> bool:
    if isinstance(value, dict):
        return len(value) > 3 or any(isinstance(v, (dict, list)) for v in value.values())
    return isinstance(value, list) and any(isinstance(v, dict) for v in value)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return ", ".join(f"{k} {_text(v)}" for k, v in value.items()) or "none"
    if isinstance(value, list):
        shown = ", ".join(_text(v) for v in value[:8])
        return f"[{shown}{', ...' if len(value) > 8 else ''}]"
    return "unknown" if value is None else str(value)
