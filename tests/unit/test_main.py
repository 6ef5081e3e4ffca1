"""The daemon as a process: what it does before anything else."""

from __future__ import annotations

import subprocess
import sys

SCRIPT = (
    "import os\nfrom daemon.store.outside import fill_standard_files\nfill_standard_files()\nos._exit(os.open('/', 0))"
)


def test_the_arms_line_never_gets_the_number_of_a_closed_standard_file() -> None:
    """Libraries write warnings to number 2, whatever is open there."""
    for closed in ("", "0<&-", "2>&-", "0<&- 1>&- 2>&-"):
        command = ["bash", "-c", f'exec "$0" -c "$1" {closed}', sys.executable, SCRIPT]
        assert subprocess.run(command, check=False).returncode > 2
