"""Comparison of methods: candidates, time budget, references, measured rows, Pareto front, report."""

__all__ = ["candidates", "measure", "pareto", "problems", "report", "truths"]
