"""Peak memory and time of a command before it computes: `--dry-run`, and the refusal of what cannot fit.

`kernels` and the modules of single commands list what a command computes for its options and the facts of
`mesh_facts` and `curve_facts`, `coefficients` (generated) what a kernel costs, `prediction` adds both up and
scales seconds by a probe of this machine, commands call `check_cost`; `batch_cost` adds up the dry runs of a
batch.
"""

__all__ = [
    "batch_cost",
    "check_cost",
    "coefficients",
    "curvature_kernels",
    "curve_facts",
    "delaunay_kernels",
    "facts",
    "geodesic_kernels",
    "kernels",
    "mesh_facts",
    "prediction",
    "simulator_kernels",
    "use",
]
