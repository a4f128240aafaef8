"""The inverse problem: only here parameters are searched."""
