"""The summary on standard output: text for people, or one strict JSON object."""

from __future__ import annotations

import json
import math
from typing import Any

import click
import numpy as np


def plain(value: Any) -> Any:
    """Numbers, lists and dicts that strict JSON can hold; what is not finite becomes null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_summary(summary: dict[str, Any], as_json: bool) -> None:
    """Print the summary on standard output."""
    summary = plain(summary)
    if as_json:
        click.echo(json.dumps(summary, allow_nan=False, ensure_ascii=False))
        return
    click.echo("\n".join(_lines(summary)))


def _lines(summary: dict[str, Any]) -> list[str]:
    lines = [f"{summary['command']} {summary['input'].get('path', '')}".rstrip()]
    for section in ("input", "results", "accuracy", "seconds"):
        for name, value in summary[section].items():
            if name != "path":
                lines.append(f"  {section + '.' if section != 'results' else ''}{name}: {_text(value)}")
    lines += [f"  wrote {path}" for path in summary["outputs"]]
    return lines


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return ", ".join(f"{k} {_text(v)}" for k, v in value.items())
    if isinstance(value, list):
        shown = ", ".join(_text(v) for v in value[:8])
        return f"[{shown}{', ...' if len(value) > 8 else ''}]"
    return "unknown" if value is None else str(value)
