"""Measured quantities: kinds of channels, their names, and the sensors that have them."""
