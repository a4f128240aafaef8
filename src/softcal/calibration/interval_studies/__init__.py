"""Intervals in another way, beside the quick ones: by profiles, a posterior, groups of the data, a bootstrap."""
