"""How many of a hundred controllers with random manners, arms and lines are introduced right, unattended.

`python -m tests.bench.introductions [COUNT] [FIRST]`: a line for each that is not, and how it ended; simulated time.
"""

from __future__ import annotations

import sys
import time

from daemon.calibration.arm_from_readings import NoArmError
from drivers.val2.contact_findings import UnclearError
from tests.fakes.strange_controllers import arm_of, draw, in_simulated_time, meet, strangers, wrong


def one(seed: int) -> str:
    """How it ended: `right`, `unclear: ...` with nothing moved, or what is wrong."""
    strange = draw(seed)
    strangers.clear()
    try:
        contact = in_simulated_time(lambda: meet(strange))
        off = wrong(strange, contact.known, arm_of(contact.known))
    except (UnclearError, NoArmError) as unclear:
        moved = any("DO DRIVE" in line for line in strangers[-1].controller.lines)
        return f"unclear{' after it moved' if moved else ', nothing moved'}: {unclear}"
    return "; ".join(off) or "right"


def main(count: int, first: int) -> int:
    """Print the table; the count of those that are wrong."""
    began_s, ends = time.process_time(), []
    for seed in range(first, first + count):
        ends.append(one(seed))
        if ends[-1] != "right":
            print(f"{seed:4}  {ends[-1]}", flush=True)
    right = ends.count("right")
    print(f"{right} of {count} right, {sum(e.startswith('unclear') for e in ends)} ended with a question; "
          f"{(time.process_time() - began_s) / count:.1f} s of processor time each")  # fmt: skip
    return count - right


if __name__ == "__main__":
    words = [int(word) for word in sys.argv[1:]]
    main(*[*words, *(100, 0)[len(words) :]])
