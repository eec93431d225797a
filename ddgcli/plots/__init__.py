"""Pictures of results: shaded surfaces, curves, charts, and the motion of simulations.

The only place that imports matplotlib. `page` lays out a figure, `raster` draws large meshes as pixels.
"""

__all__ = [
    "animation",
    "array",
    "chart",
    "colour",
    "curve",
    "glyphs",
    "hiding_planes",
    "motion",
    "page",
    "raster",
    "surface",
    "viewpoint",
    "web_page",
]
