"""Comparison of methods: candidates, time budget, references, measured rows, Pareto front, report."""
