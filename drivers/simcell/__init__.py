"""Simulated cell: arm, VAL II controller, gripper, light, cameras and parts; a witness of what happened, a monitor of
of what must never happen. etc/simcell.yaml says what it is like. Nothing here knows of the daemon.
"""
