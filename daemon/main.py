"""The command line of the daemon, `facetd`. daemon/service.py does the work.

Exit status: 0 ended on request, 1 a fault in the program, 2 a device is not available, 78 an unusable configuration,
calibration or model (systemd does not restart after that).
"""

import argparse
import asyncio
import contextlib
import gc
import logging
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from daemon import VERSION
from daemon.store import folders
from daemon.store.outside import fill_standard_files

if TYPE_CHECKING:
    from daemon.service import Service


def main(arguments: list[str] | None = None) -> int:
    """Run the daemon; with --check only check its files."""
    args = parser().parse_args(arguments)
    if args.check:
        return check(args.config, args.sim)
    return serve(args.config, args.sim)


def parser() -> argparse.ArgumentParser:
    """The parser of the daemon's command line."""
    made = argparse.ArgumentParser(prog="facetd", description="Recognises parts by their facets and picks them.")
    named = "the configuration (default: %(default)s)"
    made.add_argument("--config", type=Path, default=folders.config_file(), metavar="FILE", help=named)
    made.add_argument("--sim", action="store_true", help="a simulated cell instead of the one configured")
    made.add_argument("--check", action="store_true", help="check configuration, calibration and model, and end")
    made.add_argument("--version", action="version", version=f"facetd {VERSION}", help="the program's version")
    return made


def check(config_path: Path, simulated: bool) -> int:
    """Read every file that the daemon reads; open no device. An error is one line and status 78."""
    from daemon.service import BAD_CONFIGURATION, read_files
    from daemon.store.job_file import unreadable
    from daemon.store.outside import FileError

    try:
        config, _, _ = read_files(config_path, simulated)
    except FileError as error:
        print(f"facetd: {error}", file=sys.stderr)
        return BAD_CONFIGURATION
    for note in (*config.notes, *(f"{why}; this job cannot be run" for why in unreadable(config.jobs))):
        print(f"facetd: {note}", file=sys.stderr)
    print(f"facetd: {config.path} is good: a {config.kind} cell, socket {config.socket}, runs in {config.runs}")
    return 0


def serve(config_path: Path, simulated: bool) -> int:
    """Run the daemon until a signal ends it."""
    import faulthandler

    fill_standard_files()
    if sys.stderr is not None:
        faulthandler.enable()
    tame_malloc()
    service = the_service()
    logging.getLogger("asyncio").setLevel(logging.CRITICAL)

    async def live() -> int:
        return await service(config_path, simulated).run()

    status = asyncio.new_event_loop().run_until_complete(live())
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    # All is stopped and written. A driver's thread that hangs in the kernel must not keep the process.
    os._exit(status)


def the_service() -> "type[Service]":
    """Load the program without garbage collection, and exempt what it made from every later one.

    The collector would go through all of it seven times while it grows, a tenth of the start, and later for 30 ms at a
    time, in which nothing stops the arm.
    """
    gc.disable()
    from daemon.service import Service

    gc.freeze()
    gc.enable()
    return Service


def tame_malloc() -> None:
    """Make glibc use one arena and return large arrays: otherwise it keeps some 50 MB of freed images.

    Up to 16 MiB stay for the next look: where 4 did, the kernel cleared its arrays anew, a tenth of its time.
    Call it before any thread starts. Without glibc it does nothing. Source: mallopt(3).
    """
    import ctypes

    trim_threshold, mmap_threshold, arena_max = -1, -3, -8
    with contextlib.suppress(OSError, AttributeError):
        libc = ctypes.CDLL("libc.so.6")
        libc.mallopt(arena_max, 1)
        libc.mallopt(mmap_threshold, 1 << 20)
        libc.mallopt(trim_threshold, 16 << 20)


if __name__ == "__main__":
    sys.exit(main())
