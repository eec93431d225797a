"""Straightest geodesics: `trace.trace` and `trace.Tracer` trace thousands of lines at once."""

__all__ = ["crossing", "lines", "trace"]
