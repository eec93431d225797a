"""Straightest geodesics: `trace.trace` and `trace.Tracer` follow thousands of lines at once across a
surface."""
