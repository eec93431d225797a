"""Figures behind statements of the manual, on problems with known answers."""
