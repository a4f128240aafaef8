"""The preparation steps: each a function from a dataset to the next, registered with its settings."""
