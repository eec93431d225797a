"""A command that measures one kernel, and sizes of its inputs."""

from __future__ import annotations

from dataclasses import dataclass

SIZES, SMALL_SIZES, SHELL_SIZES = (10_000, 80_000), (2_000, 14_000), (1_000, 10_000, 60_000)
SOLID_SIZES = (2_000, 14_000, 60_000)  # of tetrahedra, whose factors fill more
CURVE_SIZES = (*SMALL_SIZES, 60_000)  # points
LARGE_SIZES = (10_000, 80_000, 500_000)  # where caches and fill give an exponent above 1.05
PIECE_SIZES = (10_000, 100_000, 600_000)  # of shells, whose elements are summed in pieces beyond 350,000
SHELL = "--material felt --set thickness=1e-3 --effect stretching --effect gravity"
STIFF = "--material felt --set thickness=5e-3 --set young=1e9 --effect stretching --effect gravity"
ITERATIVE_EXPONENTS = (("multigrid", 1.15), ("conjugate-gradients", 1.45))  # growth of one solution
MANY = ",".join(map(str, range(17)))  # vertices
TARGETS, PAIRS = ",".join(map(str, range(1, 1001))), [f"{k},{k + 1000}" for k in range(100)]


@dataclass(frozen=True)
class Task:
    """A kernel, the command that measures it (`{mesh}`, `{out}`: files), the growth of its seconds."""

    kernel: str
    words: str
    sizes: tuple[int, ...] = SIZES
    mesh: str = "sphere"
    exponent: float = 1.05
    suffix: str = ""  # of the kernel's name: kind of elements other than faces
    short: bool = False  # the command computes its short summary only
    solver: str = "auto"  # of linear systems
    uses: float | str = ""  # of the kernel in this command; a name in `results`; default as predicted
