"""Mutated inputs of every kind we read ourselves: `python -m benchmarks.fuzz`."""
