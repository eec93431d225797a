"""MkDocs hooks: citations `[@key]` become links to references.md, which lists the entries of references.bib.

An unknown key is a warning, which `mkdocs build --strict` turns into an error.
"""

from __future__ import annotations

import logging
import re
from pathlib import Path
from typing import Any

BIBLIOGRAPHY = Path(__file__).with_name("references.bib")
CITATION = re.compile(r"\[@([\w:-]+)\]")
LIST_MARK = "<!-- list of references.bib -->"
log = logging.getLogger("mkdocs.hooks.references")


def read_bibliography(text: str) -> dict[str, dict[str, str]]:
    """Entries of a BibTeX text by key; every field is one line `name = {value},`."""
    entries = {}
    for key, body in re.findall(r"^@\w+\{([\w:-]+),\n(.*?)^\}", text, re.M | re.S):
        entries[key] = dict(re.findall(r"^\s*(\w+)\s*=\s*\{(.*)\},?$", body, re.M))
    return entries


def short_name(entry: dict[str, str]) -> str:
    """Family names and year: `Crane et al. 2013`."""
    names = [name.split(",")[0] for name in entry["author"].split(" and ")]
    who = names[0] + " et al." if len(names) > 2 else " and ".join(names)
    return f"{who} {entry['year']}"


def reference_line(key: str, entry: dict[str, str]) -> str:
    """One item of the list of references."""
    authors = entry["author"].replace(" and ", "; ")
    fields = [
        f"{authors}: *{entry['title']}*",
        entry.get("journal", entry.get("booktitle", "")),
        entry["year"],
    ]
    line = ", ".join(field for field in fields if field)
    link = f" [doi:{entry['doi']}](https://doi.org/{entry['doi']})" if "doi" in entry else ""
    return f'- <a id="{key}"></a>**{key}** {line}.{link}'


def package_version() -> str:
    """Version of the package, read from its only place."""
    text = (Path(__file__).parents[1] / "ddgcli" / "__init__.py").read_text(encoding="utf-8")
    return re.findall(r'^__version__ = "(.+)"$', text, re.M)[0]


def on_config(config: Any) -> Any:
    """Show the version at the foot of every page."""
    config["copyright"] = f"ddgcli {package_version()}"
    return config


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Replace citations and the list mark of a page."""
    entries = read_bibliography(BIBLIOGRAPHY.read_text(encoding="utf-8"))
    to_references = "../" * page.file.src_uri.count("/") + "references.md"

    def link(match: re.Match[str]) -> str:
        key = match.group(1)
        if key not in entries:
            log.warning("%s cites %s, which references.bib lacks", page.file.src_uri, key)
            return match.group(0)
        return f"[{short_name(entries[key])}]({to_references}#{key})"

    items = "\n".join(reference_line(key, entries[key]) for key in sorted(entries))
    return CITATION.sub(link, markdown).replace(LIST_MARK, items)
