"""Coverage-guided fuzzing: lines are marked, and inputs that reach new ones are mutated further."""

import importlib
import sys

import pytest

from benchmarks.fuzz import coverage, run
from benchmarks.fuzz.inputs import Kind
from benchmarks.fuzz.mutate import mutated
from ddgcli.errors import DdgError

READER = '''"""A reader whose innermost branch needs three right bytes, one after the other."""

from ddgcli.errors import DdgError

NUMBERS: list[int] = []


def read(data):
    """Read bytes."""
    def inner(rest):
        for byte in rest:
            if byte == 99:
                return 1
        raise DdgError("no c")

    if data[:1] == b"a":
        if data[1:2] == b"b":
            try:
                return inner(data[2:3])
            finally:
                NUMBERS.append(1)
        raise DdgError("no keyword")
    match len(data):
        case 7:
            return 7
    raise DdgError("no a")


def depth(data):
    """Number of keywords that occur, in their order."""
    if b"alpha" not in data:
        return 0
    if b"alpha beta" not in data:
        return 1
    if b"alpha beta gamma" not in data:
        return 2
    if b"alpha beta gamma delta" not in data:
        return 3
    return len("alpha"), len("beta"), len("gamma"), len("delta")
'''


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of one module, whose lines are marked."""
    (tmp_path / "fuzzedpackage").mkdir()
    (tmp_path / "fuzzedpackage" / "__init__.py").write_text("")
    (tmp_path / "fuzzedpackage" / "reader.py").write_text(READER)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(coverage, "COMPILED", tmp_path / "compiled")
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    lines = coverage.LineCoverage(tmp_path, "fuzzedpackage")
    lines.start()
    yield lines, importlib.import_module("fuzzedpackage.reader")
    for name in ("fuzzedpackage", "fuzzedpackage.reader"):
        del sys.modules[name]


def reached(lines):
    (path,) = [path for path in lines.first if path.endswith("reader.py")]
    marks = lines.array_of(path)
    return {READER.splitlines()[k - 1].strip() for k in range(1, len(marks)) if marks[k]}


def test_lines_that_run_are_marked_and_no_others(package):
    lines, reader = package
    assert lines.count == 0
    with pytest.raises(DdgError, match="no a"):
        reader.read(b"x")
    assert reached(lines) == {
        "def inner(rest):", 'if data[:1] == b"a":', "match len(data):", 'raise DdgError("no a")',
    }  # fmt: skip
    assert reader.read(b"xxxxxxx") == 7
    assert reader.read(b"abc") == 1
    assert {"return 7", "return 1", "NUMBERS.append(1)"} <= reached(lines)
    assert lines.count == len(reached(lines)) == 12
    lines.clear()
    assert lines.count == 0


def test_a_marked_module_is_compiled_once_and_keeps_docstrings_and_line_numbers(package, tmp_path):
    _, reader = package
    assert reader.read.__doc__ == "Read bytes." and reader.__doc__.startswith("A reader")
    assert reader.read.__code__.co_firstlineno == 8
    assert len(list((tmp_path / "compiled").iterdir())) == 2


def test_words_of_a_format_are_the_short_texts_and_fields_of_its_modules(package):
    lines, reader = package
    with pytest.raises(DdgError):
        reader.read(b"x")
    tokens = coverage.tokens_of(lines.files())
    assert {b"a", b"b", b"NUMBERS"} <= set(tokens)
    assert b"no a" not in tokens  # two words


def test_coverage_leads_to_a_depth_that_blind_mutation_does_not_reach(package):
    lines, reader = package
    kind = Kind("reader", lambda: [b"x x x x x x"], lambda: reader.depth)
    blind, guided = (run.fuzz_in_processes(kind, 0.7, 1, lines, guided=guided) for guided in (False, True))
    assert guided.lines_of_seeds == blind.lines_of_seeds
    assert guided.lines >= blind.lines + 2
    assert guided.pool > 2 and blind.pool == 1


def test_starting_after_the_package_is_imported_is_an_error(package):
    lines, _ = package
    with pytest.raises(RuntimeError, match="imported before"):
        lines.start()


def test_mutations_use_the_words_of_the_format_and_pieces_of_other_files():
    import random

    rng = random.Random(0)
    inputs = [mutated(b"alpha 1\nbeta 2\n", rng, [b"gamma 3\ndelta 4\n"], [b"epsilon"]) for _ in range(1500)]
    for piece in (b"epsilon", b"alpha 1\ndelta 4\n", b"beta 2\nbeta 2\n", b"9223372036854775808"):
        assert any(piece in data for data in inputs), piece
