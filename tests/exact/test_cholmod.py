"""Kernels that the BLAS of CHOLMOD's wheel takes."""

import os
import subprocess
import sys

import numpy as np
import pytest

from ddgcli.linalg.cholmod import KERNEL_VARIABLE, cholmod_available

FEATURES = np._core._multiarray_umath.__cpu_features__
CALL = f"""
import os
from ddgcli.linalg.cholmod import cholmod_available
before = os.environ.get("{KERNEL_VARIABLE}")
assert cholmod_available() and os.environ.get("{KERNEL_VARIABLE}") == before
"""


def kernels(**variables):
    """Kernels of each OpenBLAS that a process loads, in order."""
    environment = {name: value for name, value in os.environ.items() if name != KERNEL_VARIABLE}
    environment |= {"OPENBLAS_VERBOSE": "2", **variables}
    call = [sys.executable, "-c", CALL]
    lines = subprocess.run(call, env=environment, check=True, capture_output=True, text=True).stderr.split(
        "\n"
    )
    return [line.removeprefix("Core: ") for line in lines if line.startswith("Core: ")]


@pytest.mark.skipif(not cholmod_available(), reason="needs the extra `fast`")
@pytest.mark.skipif(not (FEATURES.get("AVX2") and FEATURES.get("FMA3")), reason="needs AVX2")
def test_the_blas_of_cholmod_uses_avx2_where_the_processor_has_it():
    """Its list lacks processors of 2019 and later: kernels of 2004 factorised in three times the seconds."""
    cores = kernels()
    if not cores:
        pytest.skip("no OpenBLAS that reports its kernels")
    assert cores[-1] == "Haswell" and kernels(**{KERNEL_VARIABLE: "Sandybridge"})[-1] == "Sandybridge"
