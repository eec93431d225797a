"""Problems of the compared commands: candidates, parameters and references, one module a command."""

__all__ = ["geodesic", "conservation", "simulate", "table"]
