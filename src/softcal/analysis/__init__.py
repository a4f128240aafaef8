"""Assessment of a result: loss landscape, agreement of fits, mesh study, validation."""
