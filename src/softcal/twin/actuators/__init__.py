"""The actuators but cables: each a class in a file of its own, which registers itself."""
