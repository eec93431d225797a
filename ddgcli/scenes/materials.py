"""Material presets: typical textbook values; any key may be overridden beside `material`."""

from __future__ import annotations

import sys
from typing import Any

# volume density [kg/m^3], Young's modulus [Pa], Poisson's ratio, thickness [m]
MATERIALS: dict[str, dict[str, float]] = {
    "cotton": {"volume_density": 500.0, "young": 5e5, "poisson": 0.3, "thickness": 4e-4},
    "silk": {"volume_density": 500.0, "young": 1e6, "poisson": 0.3, "thickness": 1.5e-4},
    "felt": {"volume_density": 250.0, "young": 5e6, "poisson": 0.2, "thickness": 2e-3},
    "leather": {"volume_density": 900.0, "young": 5e7, "poisson": 0.4, "thickness": 1.5e-3},
    "paper": {"volume_density": 800.0, "young": 2e9, "poisson": 0.2, "thickness": 1e-4},
    "leaf": {"volume_density": 700.0, "young": 1e7, "poisson": 0.3, "thickness": 3e-4},
    "rubber": {"volume_density": 1100.0, "young": 2e6, "poisson": 0.49, "thickness": 1e-3},
    "plastic": {"volume_density": 1200.0, "young": 2e9, "poisson": 0.35, "thickness": 1e-3},
    "aluminium": {"volume_density": 2700.0, "young": 7e10, "poisson": 0.33, "thickness": 2e-4},
    "steel": {"volume_density": 7850.0, "young": 2.1e11, "poisson": 0.3, "thickness": 5e-4},
    "glass": {"volume_density": 2500.0, "young": 7e10, "poisson": 0.22, "thickness": 1e-3},
}
KEYS = ("density", "thickness", "young", "poisson")
DEFAULT_MATERIAL = "cotton"


def filled(values: dict[str, Any]) -> dict[str, Any]:
    """Keys of a shell, completed from its material.

    `density` is a mass per area: volume density times thickness (the object's own where it has one).

    Parameters
    ----------
    values : dict
        Values of the section.

    Returns
    -------
    dict
    """
    name = values.get("material")
    if name is None and all(values.get(key) is not None for key in KEYS):
        return values
    preset = MATERIALS[name or DEFAULT_MATERIAL]
    out = dict(values)
    for key in ("thickness", "young", "poisson"):
        if out.get(key) is None:
            out[key] = preset[key]
    if out.get("density") is None:
        out["density"] = preset["volume_density"] * out["thickness"]
    return out


def usable_stiffness(value: float, name: str, unit: str, keys: str) -> float:
    """Check that a stiffness is within the floating-point range.

    Parameters
    ----------
    value : float
        Computed from the material or written.
    name, unit : str
        Name and unit of the stiffness.
    keys : str
        Keys that it follows from.

    Returns
    -------
    float
        `value`.

    Raises
    ------
    ValueError
        It is zero, infinite or so small that it has lost digits.
    """
    if not sys.float_info.min <= value <= sys.float_info.max:
        raise ValueError(
            f"its {name} is {value:.3g} {unit}, outside the floating-point range (2.3e-308 to 1.7e308); "
            f"change {keys}, or use other units"
        )
    return value
