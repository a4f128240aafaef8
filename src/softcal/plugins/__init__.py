"""What the core does without: one folder each, whose `entry_points.txt` names its members of the core's families."""
