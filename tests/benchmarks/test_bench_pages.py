"""Pages of benches follow from stored results, and name their question and their command."""

import re

from benchmarks.pages import PAGES, BenchResult, stored


def test_a_page_names_its_question_and_command_and_contains_the_tables():
    output = "x86_64\n\n### Lines\n\n| a |\n| --- |\n| 1 |\n"
    text = BenchResult("trace", ["20000"], "2000-01-02", output).page()
    assert text.startswith("# Benchmark: trace\n\nStraightest lines")
    assert "Made on 2000-01-02 by `python -m benchmarks.pages trace 20000`" in text
    assert "\n## Lines\n\n| a |\n| --- |\n| 1 |\n" in text
    text = BenchResult("trace", ["20000"], "2000-01-02", output, "A CPU (avx2)").page()
    assert "Made on 2000-01-02 with A CPU (avx2) by `python" in text


def test_every_page_is_what_its_stored_result_gives():
    results = {result.name: result for result in stored()}
    pages = {path.stem: path.read_text(encoding="utf-8") for path in PAGES.glob("*.md")}
    assert pages.pop("README")
    assert pages.keys() == results.keys() and len(pages) > 4
    assert [name for name, text in pages.items() if results[name].page() != text] == []


def test_the_index_links_every_page():
    links = re.findall(r"\]\((\S+)\.md\)", (PAGES / "README.md").read_text(encoding="utf-8"))
    assert {result.name for result in stored()} <= set(links)
