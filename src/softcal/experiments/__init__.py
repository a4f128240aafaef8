"""What the bench saw: files read, records on one clock, corrections and cycles, each step on record."""
