"""File formats in and out: meshes, arrays, matrices, scenes and trajectories.

`mesh_file` reads and writes every mesh format through the modules of `readers` and `writers`; `trajectories`
holds the HDF5 layout of simulations. `output_file` writes files completely or not at all.
"""

__all__ = [
    "appearance",
    "arrays",
    "matrix_file",
    "mesh_file",
    "output_file",
    "readers",
    "scene_file",
    "temporary",
    "trajectories",
    "writers",
]
