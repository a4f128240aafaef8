"""softcal's own executors, one a file."""
