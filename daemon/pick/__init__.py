"""The pick: its states, what it knows of the table, how it plans, looks, follows and grasps.

Parts are named in daemon/vision/, the arm is moved through daemon/arm/; here it is decided what to do next.
"""
