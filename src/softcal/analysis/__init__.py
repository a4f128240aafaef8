"""What a result is worth: importance, identifiability, the mesh's share, validation."""
