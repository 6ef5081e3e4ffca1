"""YAML that people write: each fault is one line with its file, line, key, what was expected and what was found."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import pytest
from msgspec import Meta

from daemon.store.yamlfile import DEEPEST, LARGEST_BYTES, MAX_VALUES, ConfigError, dotted, read


class Inner(msgspec.Struct, forbid_unknown_fields=True):
    speed: Annotated[float, Meta(gt=0, le=100)] = 50.0
    tries: Annotated[int, Meta(ge=1, le=9)] = 3
    order: Literal["nearest", "surest"] = "surest"


@dataclass(frozen=True)
class Outer:
    version: Literal[1]
    inner: Inner = field(default_factory=Inner)
    by_name: dict[str, Inner] | None = None
    many: tuple[Inner, ...] = ()
    free: dict[str, float] | None = None
    sets: tuple[dict[str, Inner], ...] = ()


PLAIN = "write the number in plain digits, or in quotes if it is none"


def told(folder: Path, text: str, kind: Any = Outer) -> str:
    """What is said of a file, without its folder."""
    (folder / "f.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        read(folder / "f.yaml").convert(kind)
    return str(refused.value).removeprefix(f"{folder}/")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("version: 1\ninner: {speed: 101}", "f.yaml:2: inner.speed: expected above 0 to 100, found 101"),
        ("version: 1\ninner:\n  tries: 0", "f.yaml:3: inner.tries: expected a whole number from 1 to 9, found 0"),
        ("version: 1\ninner: {order: big}", "f.yaml:2: inner.order: expected one of nearest, surest, found 'big'"),
        ("version: 1\ninner: {speed: fast}", "f.yaml:2: inner.speed: expected a number, found 'fast'"),
        ("version: 1\ninner: {sped: 4}", "f.yaml:2: inner.sped: unknown key; did you mean `speed`?"),
        ("version: 1\nxyz: 4", "f.yaml:2: xyz: unknown key (valid here: version, inner, by_name, many, free, sets)"),
        ("version: 1\nmany:\n - {}\n - {tries: 10}",
         "f.yaml:4: many[1].tries: expected a whole number from 1 to 9, found 10"),
        ("version: 1\nmany:\n - {}\n - {tires: 4}", "f.yaml:4: many[1].tires: unknown key; did you mean `tries`?"),
        ("version: 1\nby_name:\n  a: {tries: 2}\n  b: {tries: 77}",
         "f.yaml:4: by_name.b.tries: expected a whole number from 1 to 9, found 77"),
        ("version: 1\nby_name:\n  a: {tires: 2}", "f.yaml:3: by_name.a.tires: unknown key; did you mean `tries`?"),
        ("version: 1\nfree: {a: 1, b: x}", "f.yaml:2: free.b: expected a number, found 'x'"),
        ("version: 1\nsets:\n - {a: {tries: 2}}\n - {a: {tries: 2}, b: {tries: 10}}",
         "f.yaml:4: sets[1].b.tries: expected a whole number from 1 to 9, found 10"),
        ("version: 1\nsets:\n - {a: {tries: 2}, c: {tries: 10}}\n - {a: {}}",
         "f.yaml:3: sets[0].c.tries: expected a whole number from 1 to 9, found 10"),
        ("inner: {}", "f.yaml:1: the key `version` is missing"),
        ("version: 1\ninner: [1, 2]", "f.yaml:2: inner: expected keys and values, found [1, 2]"),
        ("version: 1\nfree: {a: '" + "x" * 90 + "'}",
         "f.yaml:2: free.a: expected a number, found '" + "x" * 56 + "..."),
        ("", "f.yaml: expected keys and values, found an empty file"),
        ("version: 1\nversion: 1", "f.yaml:2: version: the key occurs twice"),
        ("? [1, 2]\n: 3", "f.yaml:1: expected a word as key, found a list or mapping"),
        ("a: &x [*x]", "f.yaml:1: an anchor that contains itself"),
        ("version: 1\nmany: [{tries: 010}]",
         f"f.yaml:2: many[0].tries: 010 is read as 8 (base 8); {PLAIN}"),
        ("version: 1\nfree: {a: 1:30}",
         f"f.yaml:2: free.a: 1:30 is read as 90 (base 60); {PLAIN}"),
        ("a: b: c", "f.yaml:1: not valid YAML: mapping values are not allowed in this context"),
        ("a: *nobody", "f.yaml:1: not valid YAML: found undefined alias"),
        ("version: 1\na: [1, 2\n", "f.yaml:3: not valid YAML: did not find expected ',' or ']'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_place(text: str, expected: str, tmp_path: Path) -> None:
    assert told(tmp_path, text) == expected


def test_what_is_right_is_read(tmp_path: Path) -> None:
    (tmp_path / "f.yaml").write_text("version: 1\ninner:\nmany: [{speed: 100}]\nfree: {a: 0, b: 0.5}")
    found = read(tmp_path / "f.yaml").convert(Outer)
    assert found.inner == Inner()
    assert found.many == (Inner(speed=100),)
    assert found.free == {"a": 0, "b": 0.5}
    assert read(tmp_path / "f.yaml").convert(Inner, ("none",)) == Inner()


def test_a_file_may_come_to_so_many_values_and_so_deep_and_no_further(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    path.write_text("a: [" + "1," * (MAX_VALUES - 3) + "]")
    assert len(read(path).data["a"]) == MAX_VALUES - 3
    path.write_text("a: [" + "1," * (MAX_VALUES - 2) + "]")
    with pytest.raises(ConfigError, match=rf"f\.yaml:1: more than {MAX_VALUES} values"):
        read(path)
    path.write_text("[" * DEEPEST + "]" * DEEPEST)
    assert read(path).data
    path.write_text("[" * (DEEPEST + 1) + "]" * (DEEPEST + 1))
    with pytest.raises(ConfigError, match=rf"f\.yaml:1: lists or keys {DEEPEST} deep"):
        read(path)
    ten = "[" + "1," * 10 + "]"
    aliases = f"a: &a {ten}\n" + "".join(f"{n}: &{n} [{f'*{b},' * 10}]\n" for b, n in ("ab", "bc", "cd", "de"))
    path.write_text(aliases)
    with pytest.raises(ConfigError, match=rf"f\.yaml:5: more than {MAX_VALUES} values"):
        read(path)
    path.write_text("\n".join(aliases.splitlines()[:3]))
    assert len(read(path).data["c"]) == 10


def test_a_file_may_be_so_large_and_must_be_text(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    path.write_bytes(b"a: 1 #" + b"x" * (LARGEST_BYTES - 6))
    assert read(path).data == {"a": 1}
    path.write_bytes(b"a: 1 #" + b"x" * (LARGEST_BYTES - 5))
    with pytest.raises(Exception, match="too large"):
        read(path)
    path.write_bytes(b"a: \xff")
    with pytest.raises(ConfigError, match=r"f\.yaml: not a text file \(UTF-8 expected\)"):
        read(path)
    path.write_bytes(b"a: \x07")
    with pytest.raises(ConfigError, match=r"f\.yaml: not valid YAML: [^\n]+$"):
        read(path)


def test_keys_that_are_none_any_more_are_left_out_and_told(tmp_path: Path) -> None:
    (tmp_path / "f.yaml").write_text("version: 1\ninner:\n  old: 7\n  tries: 2\nother: 3\n")
    whole = read(tmp_path / "f.yaml")
    document, notes = whole.without(
        {"inner.old": "it is `tries` now", "other": "gone", "inner.never": "x", "a.b.c": "y"}
    )
    assert [note.removeprefix(f"{tmp_path}/") for note in notes] == [
        "f.yaml:3: inner.old: no longer a key, and ignored: it is `tries` now",
        "f.yaml:5: other: no longer a key, and ignored: gone",
    ]
    assert document.convert(Outer).inner == Inner(tries=2)
    assert whole.data["inner"]["old"] == 7


def test_places_in_a_file_are_written_as_people_write_them() -> None:
    assert dotted(("cameras", 0, "device")) == "cameras[0].device"
    assert dotted((0, "a")) == "[0].a"
    assert dotted(()) == ""


@pytest.mark.parametrize("keys", [("a", 5), ("a", 0, 3), ("b", 0), ("a", "x"), (3,)])
def test_a_place_that_the_file_has_not_is_told_all_the_same(keys: tuple[str | int, ...], tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("a: [1, 2]\nb: {c: 1}\n")
    told = str(read(tmp_path / "c.yaml").error(keys, "is missing"))
    assert told.startswith(f"{tmp_path}/c.yaml")
    assert told.endswith("is missing")


@pytest.mark.parametrize(
    ("text", "value"),
    [("4e-04", 4e-4), ("7.5e1", 75.0), ("1E2", 100.0), ("-2.e+0", -2.0), (".5e1", 5.0), ("6.5", 6.5), ("1e0", 1.0)],
)
def test_numbers_with_exponents_are_numbers_as_yaml_1_2_has_them(tmp_path: Path, text: str, value: float) -> None:
    (tmp_path / "f.yaml").write_text(f"version: 1\nfree: {{a: {text}}}\n")
    assert read(tmp_path / "f.yaml").convert(Outer).free == {"a": value}


def test_a_quoted_number_stays_text_and_a_word_like_one_too(tmp_path: Path) -> None:
    (tmp_path / "f.yaml").write_text("a: '4e-04'\nb: e4\nc: 4e\nd: 1e5x\n")
    assert read(tmp_path / "f.yaml").data == {"a": "4e-04", "b": "e4", "c": "4e", "d": "1e5x"}
