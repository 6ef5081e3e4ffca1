"""The worker process: looks, fusing, planning and training run there; the process that stops the arm never waits.

Here: how a function and its values get to the worker and back, and what becomes of a worker that is killed, runs out of
memory or time. What is computed is its callers' business: any module-level function on values that can be pickled.
"""
