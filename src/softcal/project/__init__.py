"""The project file, and what is made of it: the only package that knows YAML and run folders."""
