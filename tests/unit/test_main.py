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


LOADED = """
import gc
from daemon.main import the_service
before = gc.get_stats()
the_service()
assert gc.isenabled()
print(gc.get_freeze_count(), len(gc.get_objects()), sum(now["collections"] - was["collections"]
      for was, now in zip(before, gc.get_stats(), strict=True)))
"""


def test_garbage_collection_never_goes_through_the_program_itself() -> None:
    """Through all of it takes 30 ms, and nothing stops the arm meanwhile."""
    done = subprocess.run([sys.executable, "-c", LOADED], check=True, capture_output=True, text=True)
    exempt, looked_at, collections = map(int, done.stdout.split())
    assert exempt > 20 * looked_at
    assert collections <= 1  # the first after it


FOR_FEW = (
    *("daemon.vision.look", "daemon.vision.hypotheses", "http.server", "urllib.request", "importlib.metadata"),
    *("plotly", "trimesh", "pyarrow", "prometheus_client", "pymodbus", "starlette", "prompt_toolkit"),
)


def test_the_daemon_loads_neither_what_the_worker_computes_nor_what_few_ask_for() -> None:
    """Together a tenth of what a start takes, and of the memory."""
    script = f"import sys, daemon.main\ndaemon.main.the_service()\nprint(*{{*{FOR_FEW}}} & {{*sys.modules}})"
    assert subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout == "\n"
