"""The errors of the VAL II link: each says what happened and what is known of the arm."""

from drivers.val2.wire import Where

VAL_MESSAGES = (
    ("emergency stop", "emergency_stop"),
    ("e-stop", "emergency_stop"),
    ("arm power", "arm_power"),
    ("envelope error", "envelope_error"),
    ("not calibrated", "not_calibrated"),
    ("floppy", "controller_restarted"),
    ("asks", "controller_restarted"),
    ("out of range", "out_of_reach"),
)
"""Phrases in VAL II's messages, in lower case, and the codes of what they mean."""
HALTED = (
    "the controller's processor is halted: an LSI-11's console (ODT) answers with `@`, and VAL does not run. Set its "
    "HALT/RUN switch to RUN; at the controller's own terminal type P to go on where it was, or switch it off and on"
)


def lacks_zero(message: str) -> bool:
    """Whether a message says that the arm is not calibrated: then only CAL can move it."""
    return "not calibrated" in message.lower()


class LinkError(Exception):
    """A command was not carried out, or may not have been. where: the last WHERE since then, if any."""

    code = "controller_silent"
    """The code of the cause, the same in every release (daemon/events/codes.py has its text)."""

    def __init__(self, message: str, where: Where | None = None, code: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.where = where
        self.code = code or self.code


class PortError(LinkError):
    """The serial port is absent, busy or unplugged."""


class NoAnswer(LinkError):  # noqa: N818 - it reads as what happened
    """The controller did not answer in time."""


class Busy(NoAnswer):
    """The controller echoes input but gives no prompt: it is still carrying something out."""


class ProcessorHalted(NoAnswer):
    """The controller's LSI-11 is halted: its console answers instead of VAL."""

    def __init__(self) -> None:
        super().__init__(HALTED)


class Garbled(LinkError):  # noqa: N818
    """Noise on the line: a command or an answer was damaged."""

    code = "line_noise"


class Interleaved(Garbled):
    """The echo contains more than facetd typed: somebody else's line is mixed into it. heard: the whole echo."""

    def __init__(self, heard: bytes) -> None:
        self.heard = heard.decode("latin-1").strip()
        super().__init__(f"more came back than was typed (echoed {self.heard[:100]!r})")


class ControllerError(LinkError):
    """The controller refused a command; the message has its text."""

    code = "controller_refused"

    def __init__(self, message: str, where: Where | None = None) -> None:
        super().__init__(message, where, next((c for words, c in VAL_MESSAGES if words in message.lower()), None))


class StopWordRefused(ControllerError):  # noqa: N818
    """The controller does not accept the stop command. An arm that comes to rest by itself was not stopped."""


class Disturbed(LinkError):  # noqa: N818
    """The controller sent something that answers no line of facetd's: somebody else types on this line."""

    code = "other_terminal"


class Elsewhere(LinkError):  # noqa: N818
    """The arm is at rest away from its target."""

    code = "arm_not_there"


class Preempted(LinkError):  # noqa: N818
    """A stop took over the line: the interrupted command was given up."""


class LineHeldBack(LinkError):  # noqa: N818
    """A motion command was held before its line end was sent: it was cancelled, and nothing was carried out."""
