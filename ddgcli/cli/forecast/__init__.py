"""Prediction of the peak memory and time of a command: `--dry-run`, and errors for runs that do not fit.

A command consists of kernels with measured costs. `kernels` and the modules of single commands list the
kernels of a command for its options and its input, whose properties (facts) `mesh_facts` and `curve_facts`
compute; `coefficients` (generated) has the cost of each kernel. `prediction` adds the costs up and scales
seconds by a probe of this machine. Commands call `check_cost`; `batch_cost` adds up the dry runs of a batch.
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
