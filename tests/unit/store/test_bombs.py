"""Small files that would come to much, and names that lead elsewhere: refused before anything is made of them."""

from __future__ import annotations

import io
import json
import random
import tracemalloc
import zipfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from daemon.config import load_config
from daemon.review.page import read_digest, write_page
from daemon.review.replay import ReplayInputs, replayed_looks
from daemon.store.folders import HOUSE
from daemon.store.library import load_facets
from daemon.store.model import LARGEST_UNFOLDED, ModelError, from_bytes, load, to_bytes
from daemon.store.npz import ArchiveError, pack, unpack
from daemon.store.outside import FileError
from daemon.store.pictures import MAX_PIXELS, PictureError, claimed_pixels, read_grey
from daemon.store.runs import RunError, kept_file
from daemon.store.yamlfile import ConfigError, read
from daemon.vision.model import empty_model
from tests.fakes.hostile import READERS, claiming, fitting
from tests.fakes.made_run import MadeRun

MOST_MEMORY = 100_000_000


@pytest.fixture(autouse=True)
def little_memory() -> Iterator[None]:
    tracemalloc.start()
    yield
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < MOST_MEMORY


def bomb(levels: int) -> str:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (bomb(30), "more than 50000 values"),
        ("a: &a [x, *a, *a]\n", "contains itself"),
        ("a: " + "[" * 900 + "]" * 900, "lists or keys 40 deep"),
        ("a: " + "{a: " * 60_000, "lists or keys 40 deep"),
        ("- " * 60_000, "lists or keys 40 deep"),
        ("[" + "x," * 60_000 + "]", "more than 50000 values"),
    ],
    ids=["aliases of aliases", "an alias of itself", "deep", "deeper than any stack", "deep blocks", "long"],
)
def test_yaml_that_comes_to_much_is_refused_with_its_line(text: str, problem: str, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(ConfigError, match=problem):
        load_config(tmp_path / "c.yaml")


def test_aliases_that_people_use_are_read(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("a: &a {x: 1}\nb: *a\nc: {<<: *a, y: 2}\n")
    assert read(tmp_path / "c.yaml").data == {"a": {"x": 1}, "b": {"x": 1}, "c": {"x": 1, "y": 2}}


def test_a_model_that_unfolds_to_a_thousand_times_its_size_is_refused_before_it_does(tmp_path: Path) -> None:
    out = io.BytesIO()
    with (
        zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.npy", "w", force_zip64=True) as file,
    ):
        for _ in range(300):
            file.write(bytes(1_000_000))
    (tmp_path / "m.npz").write_bytes(out.getvalue())
    assert len(out.getvalue()) < 1_000_000
    with pytest.raises(ModelError, match=r"m\.npz: not a facetd model: expands to more than 256 MB"):
        load(tmp_path / "m.npz")


def test_a_model_whose_nodes_come_to_more_than_a_memory_may_is_refused_before_they_are_made() -> None:
    """A file has only what is filled of each node's matrices."""
    arrays = unpack(to_bytes(empty_model(load_facets())), LARGEST_UNFOLDED)
    header = json.loads(arrays.pop("header").tobytes()) | {"matrix_size": 1000}
    del header["sha256"]
    arrays["counts"] = np.ones((1000, 0), np.int64)
    with pytest.raises(ModelError, match="nodes: 1000 of 1000 slots need more than"):
        from_bytes(fitting(header, arrays))


def test_an_archive_that_lies_about_its_sizes_is_refused() -> None:
    content = pack({"a": np.zeros(200_000)})
    for size in (10, 2**31):
        small = bytearray(content)
        at = small.rindex(b"PK\x01\x02")
        small[at + 24 : at + 28] = size.to_bytes(4, "little")
        with pytest.raises(ArchiveError):
            unpack(bytes(small), LARGEST_UNFOLDED)
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("a.npy", header.getvalue())
    with pytest.raises(ArchiveError, match="not of its declared size"):
        unpack(out.getvalue(), LARGEST_UNFOLDED)


@pytest.mark.parametrize("side", [4473, 30_000, 60_000, 2**31 - 1])
def test_a_picture_that_claims_too_many_pixels_is_not_unfolded(side: int, tmp_path: Path) -> None:
    (tmp_path / "p.png").write_bytes(claiming(side))
    with pytest.raises(PictureError, match=rf"p\.png: too large: {side**2 / 1e6:.0f} million pixels, at most 20$"):
        read_grey(tmp_path / "p.png")


def test_every_kind_of_picture_says_how_large_it_is_before_it_is_unfolded() -> None:
    (pictures,) = (reader.valid() for reader in READERS if reader.name == "picture")
    assert [claimed_pixels(content) for content in pictures[:4]] == [24 * 32] * 4
    assert claimed_pixels(b"GIF89a") is None
    assert claimed_pixels(b"P5 # a remark\n 99999 99999\n255\n") == 99_999**2
    assert claimed_pixels(b"\xff\xd8\xff\xff\xe0\0\4ab\xff\xc2\0\x11\x08\xff\xff\xff\xfe") == 65_535 * 65_534
    assert claimed_pixels(b"BM" + bytes(12) + b"\x28\0\0\0" + (7).to_bytes(4, "little") + b"\xf7\xff\xff\xff") == 63
    assert MAX_PIXELS == 20_000_000


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run whose pictures are named to lie elsewhere."""
    made = MadeRun(tmp_path / "runs" / "20260101T000000Z")
    made.pick("missed")
    folder = made.close()
    (tmp_path / "secret.png").write_bytes((folder / "images" / "000003-left.png").read_bytes())
    (folder / "images" / "link.png").symlink_to(tmp_path / "secret.png")
    return folder


@pytest.mark.parametrize("name", ["../../secret.png", "{outside}", "images/link.png", "/dev/zero"])
def test_pictures_outside_of_the_run_are_neither_shown_nor_replayed(run: Path, name: str, tmp_path: Path) -> None:
    name = name.replace("{outside}", str(tmp_path / "secret.png"))
    lines = [json.loads(line) for line in (run / "run.jsonl").read_text().splitlines()]
    for line in lines:
        if line["kind"] == "look":
            line["images"] = {"left": name, "right": name}
    (run / "run.jsonl").write_text("\n".join(map(json.dumps, lines)))
    page = write_page(run, tmp_path / "page.html").read_text()
    assert "data:image/jpeg" not in page
    calibration = next((run / "kept").iterdir())
    calibration.write_bytes((HOUSE / "etc" / "calibration.yaml").read_bytes())
    with pytest.raises(RunError, match="changed: its content"):
        list(replayed_looks(run, read_digest(run), load_facets(), ReplayInputs()))


def test_a_kept_file_must_lie_in_the_run(run: Path) -> None:
    for name in ("../../secret.png", "/etc/hostname", 7, None, "kept/none.yaml"):
        with pytest.raises(FileError):
            kept_file(run, name)


@pytest.mark.parametrize("sides", [(3, 5), (300, 200), (65535, 65535)])
def test_bitmaps_of_both_kinds_say_how_large_they_are_wherever_it_stands(sides: tuple[int, int]) -> None:
    before = b"BM" + b"\x7f" * 12
    small = before + (12).to_bytes(4, "little") + b"".join(side.to_bytes(2, "little") for side in sides)
    large = before + (40).to_bytes(4, "little") + b"".join(side.to_bytes(4, "little") for side in sides)
    upside_down = large[:22] + (-sides[1]).to_bytes(4, "little", signed=True)
    for content in (small, large, upside_down):
        assert claimed_pixels(content + b"\x7f" * 30) == sides[0] * sides[1]


NOT_AS_READ = {
    "a JPEG whose marker has no length": b"\xff\xd8\xff\x01\xff\xe0\0\4ab\xff\xc0\0\x11\x08\xff\xff\xff\xfe",
    "a JPEG with one of a restart": b"\xff\xd8\xff\xd3\xff\xe0\0\4ab\xff\xc0\0\x11\x08\xff\xff\xff\xfe",
    "a bitmap with a long header": b"BM" + bytes(12) + b"\x0c\1\0\0" + b"\1\0\1\0" + b"\xff\xff\0\0",
    "a remark that ends as on old computers": b"P5 #\r65535 65534 255 #\n1 1 255\n",
    "a remark right behind a number": b"P5 65535#65534\n1 255\n",
}


@pytest.mark.parametrize("header", NOT_AS_READ.values(), ids=NOT_AS_READ)
def test_a_header_that_opencv_reads_otherwise_than_it_looks_claims_what_opencv_reads(header: bytes) -> None:
    assert (claimed_pixels(header) or 0) in (0, 65_535 * 65_534, 65_537 * 65_535)


def test_a_jpeg_that_hides_its_size_is_read_by_neither(tmp_path: Path) -> None:
    """Behind a marker without a length stood a segment whose own length, taken for it, led past the size to another."""
    whole = cv2.imencode(".jpg", np.zeros((32, 32), np.uint8))[1].tobytes()
    long = b"\xff\xe0" + (65_000).to_bytes(2, "big") + bytes(64_998)
    other = bytearray(b"\xff\xe1" + (2000).to_bytes(2, "big") + bytes(1998))
    fake = b"\xff\xc0\0\x0b\x08\0\1\0\1\1\1\x11\0"
    at = 4 + 0xFFE0 - len(b"\xff\xd8\xff\x01" + long)
    other[at : at + len(fake)] = fake
    hidden = b"\xff\xd8\xff\x01" + long + bytes(other) + whole[2:]
    assert claimed_pixels(hidden) == claimed_pixels(whole) == 32 * 32
    assert claimed_pixels(hidden.replace(b"\xff\xd8\xff\x01", b"\xff\xd8\xff\0")) is None


def test_whatever_opencv_unfolds_had_claimed_as_much() -> None:
    image = np.random.default_rng(1).integers(0, 255, (24, 32), np.uint8)
    whole = [cv2.imencode(kind, image)[1].tobytes() for kind in (".jpg", ".bmp", ".pgm")]
    bits = (b"\xff\x01", b"\xff\0", b"\xff\xd0", b"\xff\xe0\0\4ab", b"#", b"\r", b"\n", b" ", b"9", b"#9\r", b"\0")
    chance, unfolded = random.Random(18), 0
    for _ in range(3000):
        content = bytearray(chance.choice(whole))
        for _ in range(chance.randint(1, 4)):
            at = chance.randrange(40)
            content[at : at + chance.choice((0, 0, 1))] = chance.choice((*bits, bytes([chance.randrange(256)])))
        claimed = claimed_pixels(bytes(content))
        if claimed is not None and claimed < 1_000_000:
            found = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
            unfolded += found is not None
            assert found is None or found.size <= claimed, bytes(content[:60])
    assert unfolded > 100


@pytest.mark.timeout(20)
def test_a_jpeg_of_a_thousand_scans_is_not_begun(tmp_path: Path) -> None:
    """72 kB of them took 3 s, a megabyte would take most of a minute."""
    whole = cv2.imencode(".jpg", np.zeros((400, 400), np.uint8), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    last = whole[whole.rindex(b"\xff\xda") : -2]
    (tmp_path / "p.jpg").write_bytes(whole[:-2] + last * 1000 + whole[-2:])
    with pytest.raises(PictureError, match=r"p\.jpg: 10\d\d scans, at most 100 are read"):
        read_grey(tmp_path / "p.jpg")
    (tmp_path / "p.jpg").write_bytes(whole)
    assert read_grey(tmp_path / "p.jpg").shape == (400, 400)
