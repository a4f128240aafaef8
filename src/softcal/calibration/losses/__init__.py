"""softcal's own losses, one a file: each registers itself and needs to be named nowhere else."""
