"""Hodge decomposition of fields, harmonic fields and homology of surfaces and solids.

`decomposition` splits fields, `harmonic` computes harmonic bases, `homology` and `solid_homology` Betti
numbers and generators. `report` runs all of it.
"""

__all__ = ["decomposition", "harmonic", "hodge_analysis", "homology", "solid_homology"]
