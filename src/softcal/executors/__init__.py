"""Executors of independent calls: processes of this machine, or the workers of a cluster.

An executor is a `concurrent.futures.Executor`. Each kind is a file of its own in `kinds`, found by registration; `each`
makes many calls that share one object.
"""
