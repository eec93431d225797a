"""Hodge decomposition of fields, harmonic fields and homology of surfaces and solids.

`decomposition` splits fields, `solid_decomposition` joins those of components, `harmonic` computes
harmonic bases, `homology` and `solid_homology` Betti numbers and generators. `hodge_analysis` runs all of it.
"""

__all__ = ["decomposition", "harmonic", "hodge_analysis", "homology", "solid_decomposition", "solid_homology"]
