"""The mounted gripper, as an operator reported it last (`gripper use`): gripper.json in the state folder."""

from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from daemon.store.files import failing_as
from daemon.store.json_file import read_json, write_json
from daemon.store.outside import FileError

FILE = "gripper.json"
Text = Annotated[str, Meta(min_length=1, max_length=200)]


class MountedGripper(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Its name in the section `grippers`, who reported it, and when (UTC)."""

    name: Text
    who: Text
    at: Text
    version: Literal[1] = 1


def load_mounted(folder: Path) -> MountedGripper | None:
    """The last report; None where there is none yet. Raises FileError."""
    return read_json(folder / FILE, MountedGripper, "delete it, start facetd, then `gripper use NAME`")


def keep_mounted(folder: Path, mounted: MountedGripper | None) -> None:
    """Write it; None removes it. Raises FileError."""
    path = folder / FILE
    if mounted is not None:
        write_json(path, mounted)
        return
    with failing_as(FileError, f"{path}: not removed"):
        path.unlink(missing_ok=True)
