"""The library's commands on a project: simulate, calibrate, sweep, validate, check, export, report; run folders."""
