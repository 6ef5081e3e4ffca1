"""What may keep a move back counts up to its last byte: a hold amid its line, a refusal or another's line before it."""

from __future__ import annotations

import pytest

from drivers.val2.conversation import Unconditional
from drivers.val2.dialect import Dialect
from drivers.val2.errors import ControllerError, Disturbed, LineHeldBack
from drivers.val2.link import MoveStart
from tests.fakes.in_time import lived
from tests.unit.val2.test_link_scripted import GOAL, PROMPT, START, TRANS, Scripted, Shared, linked, usual

MOVES = "DO MOVES GOAL"


class Held(Unconditional):
    """A permission that somebody may withdraw."""

    def __init__(self) -> None:
        super().__init__()
        self.held = False

    @property
    def withheld(self) -> bool:
        """See SendPermission."""
        return self.held


@pytest.mark.parametrize("dialect", [Dialect(), Dialect(character_pause_s=0.01)], ids=["at once", "with pauses"])
def test_a_pause_that_comes_while_the_line_of_a_move_is_typed_keeps_it_from_being_ended(dialect: Dialect) -> None:
    permission = Held()

    class PausedAmid(Scripted):
        def write(self, data: bytes) -> None:
            """See Port."""
            super().write(data)
            permission.held |= self._line.decode().startswith("DO MOVES")

    async def story() -> list[str]:
        port = PausedAmid(usual)
        link = linked(port, character_pause_s=dialect.character_pause_s)
        link.permission = permission
        await link.open()
        await link.test_stop()
        with pytest.raises(LineHeldBack):
            await link.move(GOAL, start=START, straight=True)
        return port.lines

    assert MOVES not in lived(story())


def test_what_somebody_types_right_behind_the_reading_before_a_move_sends_no_move() -> None:
    """It may have set another speed, or the place to go to."""

    async def story() -> list[str]:
        port = Shared(usual)
        link = linked(port)
        await link.open()
        await link.test_stop()
        with pytest.raises(Disturbed):
            await link.move(GOAL, start=MoveStart(40.0, lambda _: port.others("SPEED 100\r\n.")), straight=True)
        return port.lines

    assert MOVES not in lived(story())


@pytest.mark.parametrize("refused", ["SPEED 40", f"DO SET GOAL={TRANS}"])
def test_where_the_speed_or_the_place_of_a_move_is_refused_no_move_is_sent(refused: str) -> None:
    """It would go as fast as somebody set it last, or to the place before."""

    async def story() -> list[str]:
        port = Scripted(lambda line, nth: "\r\n*Illegal value*" + PROMPT if line == refused else usual(line, nth))
        link = linked(port)
        await link.open()
        await link.test_stop()
        with pytest.raises(ControllerError, match="Illegal value"):
            await link.move(GOAL, start=START, straight=True)
        return port.lines

    assert MOVES not in lived(story())
