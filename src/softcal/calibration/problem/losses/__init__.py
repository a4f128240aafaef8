"""softcal's own losses, one per file: each registers itself."""
