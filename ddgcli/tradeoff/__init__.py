"""Accuracy against seconds: candidates, references, measurement, Pareto front.

`problems` asks the question of each command; `measure` runs the candidates within a time budget, `pareto`
judges the rows, `truths` holds analytic answers.
"""

__all__ = ["candidates", "measure", "pareto", "problems", "report", "richardson", "truths"]
