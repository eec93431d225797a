"""Scene files of simulators: sections, units, expressions, shapes and materials.

`scene.resolve` checks a document against the sections that a simulator contributes and fills its defaults;
`schema` writes the JSON Schema.
"""

__all__ = ["expressions", "materials", "scene", "schema", "shapes", "units"]
