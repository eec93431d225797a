"""Long runs of `fluid-sim` against published truths; see benchmarks/README.md."""
