"""Straightest geodesics: `trace.trace` and `trace.Tracer` trace thousands of lines at once."""
