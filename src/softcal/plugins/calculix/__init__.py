"""CalculiX: the robot as a deck and the program as an engine; and the cross-check of softcal with every engine."""
