"""softcal's own optimisers, one a file: each registers itself and needs to be named nowhere else."""
