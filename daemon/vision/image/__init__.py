"""One image -> straight-sided outlines and sub-pixel corners. Nothing is compared with the other eye here.

both_eyes.py only keeps the two together: what a look prepares once, and everything that runs over it takes.
"""
