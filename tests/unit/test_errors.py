"""Errors for people share one root: a frontend answers all of them, and crashes on nothing else but our own faults."""

import re
from pathlib import Path

import pytest

import daemon
from daemon.errors import FacetdError, error_text
from drivers.val2.errors import ControllerError

FOR_CALLERS = {"FacetdError", "UndeterminedError"}
"""The root itself, and what the solver tells the calibrations, which say it in their own words."""


def test_an_error_that_is_no_fault_of_the_program_has_the_root_for_people():
    told = [
        match
        for path in Path(daemon.__file__).parent.rglob("*.py")
        for match in re.findall(r"^class (\w+)\((?:Exception|RuntimeError)\)", path.read_text(), flags=re.MULTILINE)
    ]
    assert set(told) == FOR_CALLERS


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (FacetdError("the camera is gone"), "the camera is gone"),
        (ControllerError("*Arm power off*"), "*Arm power off*"),
        (OSError("the cable\ncame out"), "the cable came out"),
        (TimeoutError(), "TimeoutError"),
        (KeyError("x"), "internal error in facetd: KeyError: 'x'"),
    ],
)
def test_a_fault_names_the_class_of_an_error_only_where_it_is_one_of_the_program(error: Exception, told: str) -> None:
    assert error_text(error) == told
