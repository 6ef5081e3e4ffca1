"""What is decided before anything moves: viewpoints, grasps and approaches, and how a part gets to its place.

Pure functions on arrays: observations and what the arm can reach in, plans out. They move nothing, wait for nothing
and read no file; the handlers of the states (find.py, approach.py, take.py, set_down.py) carry the plans out.
"""

from daemon.pick.planning.next_view import (
    Gain,
    PartHypothesis,
    distinct_hypotheses,
    farthest_viewpoint,
    hypotheses_in_words,
    hypotheses_of,
    next_best,
    reachable_poses,
    untaught_hypothesis,
    viewpoints_round,
)
from daemon.pick.planning.picture import plan_picture
from daemon.pick.planning.place_goals import (
    Goal,
    PartPlaceError,
    PlaceDeviation,
    SetDown,
    deviation,
    fixture_boxes,
    flattened,
    goal_of,
    set_down_of,
    spot_of,
    too_tight,
)
from daemon.pick.planning.place_plan import SidePlan, plan_anew, plan_from_side, plan_to_place, then_in_words
from daemon.pick.planning.plan import Destination, NoPlan, Plan, final_approach, same_grasp, stable_sides
from daemon.pick.planning.regrasp import MOST_GRASPS
from daemon.pick.planning.side_look import side_that_shows_turn
from daemon.pick.planning.stand_offs import is_certain_enough, next_stand_off
from daemon.pick.planning.table_room import obstacles_of
