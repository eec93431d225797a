"""Scene files of simulators: sections, units, expressions, shapes and materials.

`scene.resolve` checks a document against the sections that a simulator contributes and fills its defaults;
`schema` writes the JSON Schema; `sections` has the base of all tables and the messages about their mistakes.
"""

__all__ = [
    "expressions",
    "key_frames",
    "materials",
    "obstacle_meshes",
    "scene",
    "scene_model",
    "schema",
    "sections",
    "shapes",
    "units",
]
