"""Geometry: meshes and their generation, regions, mesh quality, centrelines and sections of rods."""
