"""What a command does with a project: simulate, calibrate, sweep, validate, check, export, report; run folders."""
