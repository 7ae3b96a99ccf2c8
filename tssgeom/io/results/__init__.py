"""Results to files: tables, JSON objects, meshes and exports to other programs."""
