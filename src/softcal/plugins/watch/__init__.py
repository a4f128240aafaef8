"""A local page that shows a run while it works: it reads the run's folder, and writes nothing into it.

`watched` reads a folder into frozen data, `charts` and `page` draw them, `server` serves the page on this machine.
"""
