"""The results: what a search ends with, how many digits of it are shown, and its files, trial by trial."""
