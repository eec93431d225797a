"""Writers of mesh formats: functions from a mesh with arrays to bytes.

`cell_data` sorts an annotated mesh by the place of its arrays; `text`, `vtk` and `arrays` hold the formats.
"""

__all__ = ["arrays", "cell_data", "text", "vtk"]
