"""Results and accuracy of a flow, from the scalars of its frames."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.descent import folded_faces
from ddgcli.models.willmore.energies import ENERGIES
from ddgcli.models.willmore.flow import TOO_UNEVEN


def summary(
    series: Mapping[str, NDArray], convention: str, limit: int, stopped: str, failure: str
) -> tuple[dict[str, Any], dict[str, Any]]:
    """(`results`, `accuracy`).

    Parameters
    ----------
    series : mapping of str to (T,) ndarray
        Scalars of every frame.
    convention : str
    limit : int
        Steps allowed.
    stopped, failure : str
        Why it ended before, or "".
    """
    last = {name: float(values[-1]) for name, values in series.items()}
    results = {
        "energy": series["energy"].tolist(),
        "energy_convention": convention,
        "area": last["area"],
        "volume": last.get("volume"),
        "steps": int(last["steps"]),
        "stopped_because": failure or stopped or f"{limit} steps were taken",
    }
    accuracy = {
        "energy_increases": int(last["energy_increases"]),
        "area_increases": int(last["area_increases"]),
        "constraint_residuals": {
            name: float(np.abs(series[f"{name}_residual"]).max())
            for name in ("area", "volume")
            if f"{name}_residual" in series
        },
        "min_angle_degrees": series["min_angle_degrees"].tolist(),
    }
    return results, accuracy


def every_energy(first: TriangleMesh, last: TriangleMesh) -> dict[str, dict[str, Any]]:
    """All energies at start and end, with their conventions (--report-energy all)."""
    found = {}
    for name, kind in ENERGIES.items():
        energy = kind.build(first.topology)
        found[name] = {
            "start": energy.value(first.points),
            "end": energy.value(last.points),
            "energy_convention": kind.convention,
        }
    return found


def doubt(stopped: str) -> str:
    """Why the end is neither at rest nor on the flow, with the mend; or ""."""
    if stopped != TOO_UNEVEN:
        return ""
    told = f"{stopped}; begin with a finer or more even one (`ddgcli delaunay MESH --refine 25 -o finer.npz`)"
    logging.getLogger("ddgcli").warning(told)
    return told


def tell_of_folds(first: TriangleMesh, last: TriangleMesh) -> None:
    """A warning where faces have folded over: energies of such a surface mean little."""
    before, after = folded_faces(first), folded_faces(last)
    if after > before:
        logging.getLogger("ddgcli").warning(
            "%d faces are folded over at the end (%d at the start): the energy means little there; begin "
            "with a finer or more even mesh",
            after,
            before,
        )
