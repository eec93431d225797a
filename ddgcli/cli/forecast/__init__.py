"""Peak memory and time of a command before it computes: `--dry-run`, and the refusal of what cannot fit.

`kernels` and `simulator_kernels` list what a command computes for its options, `coefficients` (generated)
what a kernel costs, `prediction` adds both up and scales seconds by a probe of this machine, commands call
`check_cost`.
"""

__all__ = ["check_cost", "coefficients", "kernels", "prediction", "simulator_kernels", "use"]
