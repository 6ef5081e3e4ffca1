"""One image -> straight-sided outlines and sub-pixel corners. Nothing is compared with the other eye here.

both_eyes.py: open_eyes and Eyes, what a look prepares once. one_eye.py: OneEye, everything that one image gives. On the
way there: grey.py (noise), regions.py, outlines.py, edge_lines.py with calipers.py and step_model.py, polygon_fit.py.
"""
