"""Old words that still work: the one table of what people have learnt to type, install and send, and its name today.

tests/unit/console/test_aliases.py walks it. What a recorded run calls a thing is the store's (daemon/store/).
"""

from __future__ import annotations

COMMANDS = {"eyes": "cameras", "places": "positions"}
"""Commands of the daemon."""
JOBS = {"hall": "fleet", "live": "dashboard"}
"""Jobs of `facetctl`."""
JOB_KINDS = {("arm", "introduce"): "identify"}
"""What follows a job."""
EXTRAS = {"live": "dashboard"}
"""Extras of the package (pyproject.toml, deploy/install.sh)."""
UNITS = {"facetd-live.service": "facetd-dashboard.service"}
"""Units (deploy/)."""
MESSAGE_KEYS = {"door": "frontend"}
"""Keys of a message at the socket (frontends/socket_server.py)."""


def aliases_of(command: str) -> tuple[str, ...]:
    """The old names of a command."""
    return tuple(old for old, now in COMMANDS.items() if now == command)


def job_words(words: list[str]) -> list[str]:
    """The words of a `facetctl` job with each old one replaced."""
    job, *others = words or [""]
    job = JOBS.get(job, job)
    if others:
        others[0] = JOB_KINDS.get((job, others[0]), others[0])
    return [job, *others] if words else []
