"""For each command: its question on a mesh, its methods and their dials, what they are measured against."""
