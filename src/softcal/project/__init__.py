"""The project file and its contents: the only package that reads YAML and run folders."""
