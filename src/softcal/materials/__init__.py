"""Hyperelastic laws and their constants, one law per file."""
