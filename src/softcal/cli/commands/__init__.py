"""The commands of softcal itself, one file each; a file registers them as it is imported."""
