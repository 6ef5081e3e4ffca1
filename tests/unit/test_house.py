"""The house itself: whose names its packages are, and what a newcomer's first commands rest on."""

from importlib.metadata import entry_points, packages_distributions


def test_the_packages_daemon_and_drivers_are_facetd_s_alone() -> None:
    """Another distribution that installs a `daemon` (python-daemon does) would silently win, or merge."""
    owners = packages_distributions()
    assert set(owners["daemon"]) == {"facetd"}
    assert set(owners["drivers"]) == {"facetd"}


def test_both_commands_lead_into_the_house() -> None:
    scripts = {e.name: e.value for e in entry_points(group="console_scripts") if e.name.startswith("facet")}
    assert scripts == {"facetd": "daemon.main:main", "facetctl": "daemon.ctl:main"}
