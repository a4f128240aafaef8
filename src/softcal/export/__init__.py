"""The twin in other programs' formats, one per file."""
