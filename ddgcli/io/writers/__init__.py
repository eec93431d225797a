"""Writers of mesh formats: functions from a mesh with arrays to bytes.

`cell_data` sorts an annotated mesh by the place of its arrays; the other modules hold the formats.
"""

__all__ = ["arrays", "cell_data", "gltf", "table", "text", "vtk"]
