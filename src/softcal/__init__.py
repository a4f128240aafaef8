"""softcal: from bench measurements of a cable-driven soft robot to a calibrated finite-element twin."""
