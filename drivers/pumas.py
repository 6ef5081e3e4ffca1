"""Published arms of the PUMA's kind: their lengths, each with its source. Values only.

Sources differ by a millimetre (a 560's d3 from 125.4 to 150.05 mm), so that an arm found is named within NEAR_MM of a
line here, and the lengths its own WHEREs show go before these where they are as well known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

NEAR_MM = 1.5
INCH_MM = 25.4


@dataclass(frozen=True)
class PublishedArm:
    """lengths_mm: a2, a3, d3, d4 (drivers/puma560.py), the shoulder's offset to the right. source: who says so."""

    name: str
    lengths_mm: tuple[float, float, float, float]
    source: str


PUBLISHED = (
    PublishedArm(
        "PUMA 560 (500 series)",
        (431.8, 20.3, 150.05, 431.8),
        "robotics toolbox, model Puma560, after Corke and Armstrong-Helouvry, A search for consensus (1994)",
    ),
    PublishedArm(
        "PUMA 560 (500 series, the maker's table)",
        (431.8, 20.32, 149.09, 433.07),
        "Fu, Gonzalez, Lee, Robotics (1987), figure 2.11; Lee and Ziegler (1984)",
    ),
    PublishedArm(
        "PUMA 260 (200 series)",
        (203.2, 0.0, 127.0, 203.2),
        "the PUMA 260's link lengths in a university's course notes: 8, 8 and twice 2.5 inches",
    ),
    PublishedArm(
        "PUMA 762 (700 series)",
        (650.0, 0.0, 190.0, 600.0),
        "3D Puma Robot Demo (MATLAB File Exchange 14932) for the 762; the same for a 760 in a public kinematics file",
    ),
)


@dataclass(frozen=True)
class Likeness:
    """A published arm, the unit (mm) in which its controller counts, and on which side its shoulder's offset is.

    mirrored: the offset is to the left; None where the arm looks the same from both sides (a3 is zero). off_mm: the
    length that differs most.
    """

    arm: PublishedArm
    unit_mm: float
    mirrored: bool | None
    off_mm: float


def likeness(
    lengths: tuple[float, float, float, float],
    sigma: tuple[float, float, float, float],
    arms: Sequence[PublishedArm] = PUBLISHED,
) -> Likeness | None:
    """The one of arms nearest to lengths found (a2, a3, d3, d4, in the controller's unit), if one is near.

    Near: each length within NEAR_MM, or four standard deviations where the readings leave more open.
    """
    found: list[Likeness] = []
    for arm in arms:
        for unit_mm in (1.0, INCH_MM):
            a2, a3, d3, d4 = (unit_mm * value for value in lengths)
            seen = a2, abs(a3), abs(d3), d4
            off = [abs(one - other) for one, other in zip(seen, arm.lengths_mm, strict=True)]
            room = [max(NEAR_MM, 4.0 * unit_mm * each) for each in sigma]
            if all(each <= most for each, most in zip(off, room, strict=True)):
                mirrored = None if arm.lengths_mm[1] == 0.0 else a3 * d3 < 0
                found.append(Likeness(arm, unit_mm, mirrored, max(off)))
    return min(found, key=lambda each: each.off_mm, default=None)
