"""Simulated cell: arm, VAL II controller, gripper, light, cameras and parts, with an independent motion monitor.

etc/simcell.yaml has its true values. Nothing here imports the daemon.
"""
