"""What looks from new poses say of a calibration. In earnest: tests/cell/test_cell_calibrates.py."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daemon.calibration.board_detection import find_board
from daemon.calibration.file import Calibration
from daemon.calibration.session import BoardView, SessionError, verify
from daemon.calibration.stereo import Pair
from tests.fakes.boards import BOARD, drawn_board
from tests.fakes.rigs import unlike_rig


def test_one_eye_that_was_nowhere_far_enough_from_where_it_was_says_so() -> None:
    seen = find_board(drawn_board(), BOARD)
    views = [BoardView(np.eye(4), Pair(f"pose {k}", seen, None)) for k in range(4)]
    calibration = replace(Calibration(unlike_rig(), np.eye(4)), alone="left")
    with pytest.raises(SessionError, match="far enough apart"):
        verify(views, BOARD, calibration)
