"""The figures of a report: each module registers its own."""
