"""What softcal's speed goals are measured with. `python -m benchmarks.run` runs all and writes RESULTS.md."""
