"""The robot, its loads and commands, and the predicted readings of its sensors."""
