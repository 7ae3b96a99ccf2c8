"""Two recordings side by side: what they show alike, and by how much they differ."""
