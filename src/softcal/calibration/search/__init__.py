"""The search: its settings, its methods, and its trials, in one process, in workers, or in a study that many share."""
