"""Bench measurements: reading files, synchronising records, corrections and cycles, with provenance of every step."""
