"""Other programs that solve a robot: each module registers one."""
