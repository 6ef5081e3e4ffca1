"""Errors for people share one root: a frontend answers all of them, and crashes on nothing else but our own faults."""

import re
from pathlib import Path

import daemon

FOR_CALLERS = {"FacetdError", "UndeterminedError"}
"""The root itself, and what the solver tells the calibrations, which say it in their own words."""


def test_an_error_that_is_no_fault_of_the_program_has_the_root_for_people():
    told = [
        match
        for path in Path(daemon.__file__).parent.rglob("*.py")
        for match in re.findall(r"^class (\w+)\((?:Exception|RuntimeError)\)", path.read_text(), flags=re.MULTILINE)
    ]
    assert set(told) == FOR_CALLERS
