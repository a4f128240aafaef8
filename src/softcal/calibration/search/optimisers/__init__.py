"""softcal's own optimisers, one per file: each registers itself."""
