"""Export of the twin to other programs, one format per file, and other solvers (engines)."""
