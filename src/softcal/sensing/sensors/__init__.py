"""The sensors: each a class, which registers itself."""
