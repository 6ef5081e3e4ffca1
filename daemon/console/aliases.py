"""Aliases: the table of old names of commands, extras, units and message keys that still work, with today's names.

Old names in recorded runs are in daemon/events/upgrade.py.
"""

COMMANDS = {"eyes": "cameras", "places": "positions"}
"""Commands of the daemon."""
JOBS = {"hall": "fleet", "live": "dashboard"}
"""Subcommands of `facetctl`."""
JOB_KINDS = {("arm", "introduce"): "identify"}
"""Arguments behind a subcommand."""
EXTRAS = {"live": "dashboard"}
"""Extras of the package (pyproject.toml)."""
UNITS = {"facetd-live.service": "facetd-dashboard.service"}
"""Units (deploy/)."""
MESSAGE_KEYS = {"door": "frontend"}
"""Keys of a message at the socket (frontends/socket_server.py)."""


def aliases_of(command: str) -> tuple[str, ...]:
    """The old names of a command."""
    return tuple(old for old, now in COMMANDS.items() if now == command)


def job_words(words: list[str]) -> list[str]:
    """The arguments of `facetctl` with old names replaced."""
    job, *others = words or [""]
    job = JOBS.get(job, job)
    if others:
        others[0] = JOB_KINDS.get((job, others[0]), others[0])
    return [job, *others] if words else []
