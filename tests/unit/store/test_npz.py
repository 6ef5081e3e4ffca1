"""Arrays in bytes: as they were, the same bytes for the same arrays, and never a pickle."""

from __future__ import annotations

import contextlib
import io
import pickle
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from daemon.store.npz import ArchiveError, one_line, pack, unpack

MOST = 1_000_000
kinds = st.sampled_from([np.float64, np.int32, np.bool_, np.uint8])
some_arrays = kinds.flatmap(lambda kind: arrays(kind, array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4)))
archives = st.dictionaries(st.text("abcdefg_", min_size=1, max_size=8), some_arrays, max_size=5)


@given(archives)
def test_arrays_come_back_as_they_went(kept: dict[str, np.ndarray]) -> None:
    found = unpack(pack(kept), MOST)
    assert set(found) == set(kept)
    for name, array in kept.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name].reshape(-1), array.reshape(-1))


@given(archives)
def test_the_order_of_names_changes_no_byte(kept: dict[str, np.ndarray]) -> None:
    assert pack(kept) == pack(dict(reversed(kept.items())))


@given(st.integers(0, 10**6), st.integers(0, 255))
def test_a_damaged_archive_is_called_so_or_read_and_never_another_error(at: int, byte: int) -> None:
    content = bytearray(pack({"corners": np.arange(30.0), "label": np.array("cube")}))
    content[at % len(content)] = byte
    with contextlib.suppress(ArchiveError):
        unpack(bytes(content), MOST)


@given(st.integers(0, 10**6))
def test_an_archive_cut_short_is_called_so(length: int) -> None:
    content = pack({"corners": np.arange(30.0)})
    with pytest.raises(ArchiveError, match="cut short"):
        unpack(content[: length % len(content)], MOST)


def test_a_pickle_is_refused_unopened() -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, ...]:
            return (pytest.fail, ("a pickle was opened",))

    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(header, {"descr": "|O", "fortran_order": False, "shape": (1,)})
        archive.writestr("trap.npy", header.getvalue() + pickle.dumps(np.array([Trap()], object)))
    with pytest.raises(ArchiveError, match="an array of objects"):
        unpack(out.getvalue(), MOST)
    with pytest.raises(ArchiveError, match="not an archive"):
        unpack(pickle.dumps(Trap()), MOST)


def test_an_error_s_text_is_one_line_and_no_longer_than_a_line() -> None:
    assert one_line(ValueError("first\n  second")) == "first second"
    assert len(one_line(ValueError("x" * 1000))) == 200
    assert one_line(EOFError()) == "EOFError"


def test_the_same_arrays_are_the_same_bytes_whenever_they_are_packed() -> None:
    with zipfile.ZipFile(io.BytesIO(pack({"a": np.zeros(3), "b": np.ones(2)}))) as archive:
        assert [member.date_time for member in archive.infolist()] == [(1980, 1, 1, 0, 0, 0)] * 2


def test_what_would_need_a_pickle_is_not_packed() -> None:
    with pytest.raises(ValueError, match="allow_pickle"):
        pack({"a": np.array([{}], object)})


def test_an_archive_may_unfold_to_just_as_much_as_is_allowed() -> None:
    content = pack({"a": np.zeros(10), "b": np.ones(3)})
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        most = sum(member.file_size for member in archive.infolist())
    assert sorted(unpack(content, most)) == ["a", "b"]
    with pytest.raises(ArchiveError, match="expands to more than"):
        unpack(content, most - 1)
