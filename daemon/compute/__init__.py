"""The worker process for looks, fusing, planning and training, so that the process that stops the arm never waits.

Here: how a function and its values get to the worker and back, and what happens when a worker is killed, runs out of
memory or time. It runs any module-level function on values that can be pickled.
"""
