"""The sections of a report: each module registers its own."""
