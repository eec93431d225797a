"""Problems of the compared commands: candidates, parameters and references, one module per command."""

__all__ = ["geodesic", "conservation", "simulate", "table"]
