"""A robot for SOFA scenes: `from ROBOT_PACKAGE import add_robot`, then `add_robot(parent, "name")`."""

from .robot import PLUGINS, add_robot, read_parameters

__all__ = ["PLUGINS", "add_robot", "read_parameters"]
