"""Shapes without physics: meshes, regions, mesh quality."""
