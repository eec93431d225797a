"""Pages of benches name their question and their command, and contain the tables."""

from benchmarks.pages import page_text


def test_a_page_names_its_question_and_command_and_contains_the_tables():
    text = page_text("trace", ["20000"], "x86_64\n\n### Lines\n\n| a |\n| --- |\n| 1 |\n", "2000-01-02")
    assert text.startswith("# Benchmark: trace\n\nStraightest lines")
    assert "Made on 2000-01-02 by `python -m benchmarks.pages trace 20000`" in text
    assert "\n## Lines\n\n| a |\n| --- |\n| 1 |\n" in text
