"""Pictures of what the workflow found: figures, a page, and a recording."""
