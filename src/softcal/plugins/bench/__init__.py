"""Public benchmark cases: robots that others measured, what every method predicts of them, and how far that is off."""
