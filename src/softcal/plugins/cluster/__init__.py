"""Executors on other machines: the workers of a Dask cluster, and the jobs of a SLURM queue."""
