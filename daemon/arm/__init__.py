"""Move the arm safely: the guard's limits, collision-checked paths, moves within limits, and the stop.

Every motion of arm and gripper goes through this package. It knows nothing of picks.
"""

from daemon.arm.belief import Beliefs, BeliefSource, CellBelief, HeldPart, Reading, VoidingEvent
from daemon.arm.body import (
    Capsule,
    FixtureBox,
    KeepOut,
    Point,
    body_of,
    capsule_around,
    carried_part,
    held_anyhow,
    lie_at_boxes,
    upright_bounds,
)
from daemon.arm.collision_shapes import (
    ARM,
    BODY_MM,
    CAMERA_POINTS_MM,
    CAMERAS,
    CAMERAS_ON_HAND,
    PALM_MM,
    HandBody,
    links_like,
    suction_cup,
    two_fingers,
)
from daemon.arm.guard import Limits, MoveCommand, SupportContact, hand_of
from daemon.arm.hold import Waiting
from daemon.arm.motion import (
    UNCONFIRMED,
    Arrival,
    MovedByOthersError,
    Mover,
    MoveRefusedError,
    OutOfReachError,
    Reach,
)
from daemon.arm.mounting import CameraMounting, InWorld, OnHand, cameras_box, in_view
from daemon.arm.operators import JobEvent, OperatorRefusedError, RefusedError, operator_command
from daemon.arm.paths import speed_pct
from daemon.arm.permission import Fault, Grant, MotionPermission
from daemon.arm.plausible import Implausible
from daemon.arm.robot import ArmModel, ControllerMonitor, HeldBackError, Robot, StopRefusedError
from daemon.arm.route import PATH_MM
from daemon.arm.settling import NotSettledError, Settling, settled_pair
from daemon.arm.supervisor import Supervisor
from daemon.arm.workcell import CAMERA_NAMES, CameraName, Picture, Pictures, Recorder, Workcell
