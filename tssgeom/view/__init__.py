"""Pictures of results: Rerun recordings, meshes and the report. Only this package draws."""
