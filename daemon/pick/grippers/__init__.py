"""The kinds of gripper: dimensions, grasps of a part, working times, and what shows of an empty gripper.

Pure functions on arrays. What moves a gripper is the arm's, what its sensor reports is gripper_sensor.py's.
"""

from daemon.pick.grippers.gripper import Gripper, PlannedGrasp
from daemon.pick.grippers.suction import SuctionCup
from daemon.pick.grippers.two_fingers import TwoFingers, centre_of_mass, contact_hull, hull, tool_rotation
