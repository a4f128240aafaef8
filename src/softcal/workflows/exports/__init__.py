"""Exports for other programs: each module registers one, and imports what it needs only when it writes."""
