"""Write the manual pages of all commands: python docs/make_man.py FOLDER."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from ddgcli import __version__
from ddgcli.cli.help_pages import describe
from ddgcli.cli.main import COMMANDS, main


def page(name: str, short: str, help_text: str) -> str:
    """A manual page of section 1, with the help as it is printed."""
    escaped = help_text.replace("\\", "\\e").replace("-", "\\-")
    body = "\n".join("\\&" + line if line[:1] in (".", "'") else line for line in escaped.splitlines())
    return (
        f'.TH "{name.upper()}" 1 "" "ddgcli {__version__}"\n.SH NAME\n{name} \\- {short}\n'
        f".SH DESCRIPTION\n.nf\n{body}\n.fi\n"
    )


def pages() -> dict[str, str]:
    """File name -> manual page."""
    root = click.Context(main, info_name="ddgcli")
    written = {"ddgcli.1": page("ddgcli", main.help or "", main.get_help(root))}
    for name, (_, line) in COMMANDS.items():
        command = main.get_command(root, name)
        if command is not None:
            facts = describe(command, click.Context(command, info_name=name, parent=root))
            written[f"{facts['name']}.1"] = page(facts["name"], line, facts["help"])
    return written


if __name__ == "__main__":
    target = Path(sys.argv[1])
    target.mkdir(parents=True, exist_ok=True)
    for file, text in pages().items():
        (target / file).write_text(text, encoding="utf-8")
    sys.stdout.write(f"{len(pages())} pages in {target}\n")
