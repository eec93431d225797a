"""Trajectories of simulations: one HDF5 file per run, in the VTKHDF layout.

`writer` appends frames so that the file is complete at every moment, `trajectory` reads them, `layout`
holds names and shapes, `layout_check` what a file must hold, `paths` the paths of
particles, `row_file` the growing datasets.
"""

__all__ = ["layout", "layout_check", "paths", "row_file", "trajectory", "writer"]
