"""Names of values, functions and classes follow the table of words in CONTRIBUTING.md."""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("ddgcli", "tests", "benchmarks", "docs", "sample_meshes")
FILES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))
PARTICIPLES = {
    *("asked", "chosen", "dropped", "found", "given", "held", "kept", "made"),
    *("needed", "said", "spent", "told", "touched", "tried", "wanted"),
}
# words of several meanings: a name states which one it is (`pareto_front`, `trajectory_frame`)
AMBIGUOUS = {"front", "fronts", "frame", "frames", "part", "parts", "stage", "stages"}
METAPHORS = {"dial", "dark", "door", "house", "keeper", "lit", "mend", "purse", "sheet", "story", "wishes"}
# metaphors, and words of speech for programs and data, in prose: `files announce`, `results are unreliable`
PROSE = re.compile(
    r"\b(pays?|paid|price|lives?|lived|knows?|speaks?|walks|walked|asks?|asked|tells?|told|story|honest(?:ly)?"
    r"|trusted|trusts|says?|said|anew|forgets?|remembers?|remembered|remembering|lonely|believes?|nobody"
    r"|whoever|somebody|deserves?|by itself|stands? (?:beside|behind|still|once|on|in)|stood|goes on|went on"
    r"|for ever|forever|afresh|mends?|mended|spoils?|spoilt|hurts?|wants|wanted|wishes)\b"
)  # of lower-case text: four times as fast as without regard to case
PROSE_FILES = sorted(
    path
    for path in (
        *FILES,
        *(ROOT / "docs").rglob("*.md"),
        ROOT / "README.md",
        ROOT / "benchmarks" / "README.md",
    )
    if path.parent.name != "accuracy" and path != Path(__file__)
)


def defined(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """(line, name) of everything that a module names; what it imports keeps its own name."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield node.lineno, name
            case ast.arg(arg=name) | ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                yield node.lineno, name
            case ast.alias(asname=str(name)):
                yield node.lineno, name


def banned(tree: ast.Module) -> list[tuple[int, str]]:
    """Names that are participles or have several meanings, or that contain the word of a metaphor."""
    return [
        (line, name)
        for line, name in defined(tree)
        if name.strip("_").lower() in PARTICIPLES | AMBIGUOUS or set(name.lower().split("_")) & METAPHORS
    ]


def test_no_value_is_named_by_a_participle_a_metaphor_or_a_word_of_several_meanings():
    words = "|".join(sorted(PARTICIPLES | METAPHORS | AMBIGUOUS))
    # a word where a name may be bound; only files with one are parsed, which takes seconds less
    candidate = re.compile(rf"(?<![^\W_])(?:{words})(?:_\w+)?\s*(?:[=:,)(]|in\b|$)", re.MULTILINE)
    sources = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in FILES}
    parsed = {path: ast.parse(source) for path, source in sources.items() if candidate.search(source.lower())}
    assert len(sources) > 300 and len(parsed) > 5
    assert {path: names for path, tree in parsed.items() if (names := banned(tree))} == {}


@pytest.mark.parametrize(
    "code",
    [
        "found = 1",
        "def f(given): ...",
        "class Purse: ...",
        "x.told = 2",
        "import numpy as sheet",
        "A_DIAL = 1",
        "for frame in range(3): ...",
        "def parts(): ...",
        "def f(): _front = 1",
    ],
)
def test_a_banned_name_is_detected(code):
    assert len(banned(ast.parse(code))) == 1


def test_no_two_classes_of_the_package_share_a_name():
    names = Counter(
        name
        for path in (ROOT / "ddgcli").rglob("*.py")
        for name in re.findall(r"^class ([A-Za-z]\w*)", path.read_text(encoding="utf-8"), re.M)
    )
    assert len(names) > 200
    assert [name for name, count in names.items() if count > 1] == []


def test_the_word_table_is_in_contributing():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("## Words")[1]
    words = set(re.findall(r"[a-z]+", text))
    assert words >= PARTICIPLES | METAPHORS


def test_no_docstring_comment_message_or_page_uses_a_metaphor_of_the_list():
    uses = {
        f"{path.relative_to(ROOT)}:{number}": line.strip()
        for path in PROSE_FILES
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if PROSE.search(line.lower())
    }
    assert len(PROSE_FILES) > 300
    assert uses == {}


def test_a_metaphor_in_prose_is_detected():
    assert PROSE.search("the reader knows no tetrahedra.") and PROSE.search("it goes on for ever")
    assert not PROSE.search("a known value on standard error is unknown to the understanding.")
