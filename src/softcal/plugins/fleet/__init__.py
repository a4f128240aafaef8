"""Many specimens calibrated by one template, and how they differ: spread, factors, modulus against infill."""
