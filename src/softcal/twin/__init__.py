"""What the robot is, what is done to it, and what its sensors would read."""
