"""What can go wrong between us and the controller, each saying what happened and what is known of the arm."""

from drivers.val2.wire import Where

SAID_BY_VAL = (
    ("emergency stop", "emergency_stop"),
    ("e-stop", "emergency_stop"),
    ("arm power", "arm_power"),
    ("envelope error", "envelope_error"),
    ("floppy", "controller_restarted"),
    ("asks", "controller_restarted"),
    ("out of range", "out_of_reach"),
)
"""Words of VAL II's messages, in small letters, and what they are signs of."""
HALTED = (
    "the controller's processor is halted: an LSI-11's console (ODT) answers with `@`, and VAL does not run. Set its "
    "HALT/RUN switch to RUN; at the controller's own terminal type P to go on where it was, or switch it off and on"
)


def lacks_zero(said: str) -> bool:
    """Whether a controller says that the arm has not found its zero: nothing but CAL can move it then."""
    return "not calibrated" in said.lower()


class LinkError(Exception):
    """The robot did not do, or is not known to have done, what it was asked. where: the last WHERE since, if any."""

    code = "controller_silent"
    """Stable, in every release: what it is a sign of (daemon/events/codes.py has the words)."""

    def __init__(self, message: str, where: Where | None = None, code: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.where = where
        self.code = code or self.code


class PortError(LinkError):
    """The serial port is absent, busy or gone."""


class NoAnswer(LinkError):  # noqa: N818 - it reads as what happened
    """The controller did not answer in time."""


class Busy(NoAnswer):
    """The controller echoes what is typed and gives no prompt: it is still carrying something out."""


class ProcessorHalted(NoAnswer):
    """The controller's LSI-11 is halted: its console answers, and no VAL."""

    def __init__(self) -> None:
        super().__init__(HALTED)


class Garbled(LinkError):  # noqa: N818
    """Noise on the line: what was typed or answered did not come through whole."""

    code = "line_noise"


class Interleaved(Garbled):
    """What was echoed holds more than what was typed: another's line between the letters of ours. heard: all of it."""

    def __init__(self, heard: bytes) -> None:
        self.heard = heard.decode("latin-1").strip()
        super().__init__(f"more came back than was typed (echoed {self.heard[:100]!r})")


class ControllerError(LinkError):
    """The controller refused, in its own words."""

    code = "controller_refused"

    def __init__(self, message: str, where: Where | None = None, code: str | None = None) -> None:
        super().__init__(
            message, where, code or next((c for words, c in SAID_BY_VAL if words in message.lower()), None)
        )


class StopRefused(ControllerError):  # noqa: N818
    """The controller does not take the word that is to stop the arm; that it came to rest by itself is no stop."""


class Disturbed(LinkError):  # noqa: N818
    """Something was heard that answers nothing of ours: somebody else types on this line."""

    code = "other_terminal"


class Elsewhere(LinkError):  # noqa: N818
    """The arm is at rest, but not where it was sent."""

    code = "arm_not_there"


class Preempted(LinkError):  # noqa: N818
    """An abort came in between: whatever was being done is no longer being done."""


class HeldBack(LinkError):  # noqa: N818
    """What moves was held back as its line was about to be ended: it was taken back, and nothing was carried out."""
