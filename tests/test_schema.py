"""Typed objects from a mapping, and what is said of a mistake."""

from dataclasses import FrozenInstanceError, dataclass
from typing import Annotated, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.schema import EndingIn, Range, as_change, build, convert, describe, flatten, set_value


@dataclass(frozen=True)
class Engine:
    kind: Literal["steam", "diesel"]
    power: Annotated[float, Range(0, 100, open="low")]


@dataclass(frozen=True)
class Ship:
    masts: Annotated[int, Range(0, 3)]
    name: str
    flagged: bool
    engine: Engine
    ports: Literal["all"] | list[str]


GOOD = {
    "masts": 2,
    "name": "Fram",
    "flagged": True,
    "engine": {"kind": "steam", "power": 50},
    "ports": ["Oslo", "Bergen"],
}


def mistakes_of(tree):
    mistakes = []
    assert build(Ship, tree, mistakes) is None
    return mistakes


def test_a_good_mapping_becomes_a_frozen_object_of_the_declared_types():
    mistakes = []
    ship = build(Ship, GOOD, mistakes)
    assert mistakes == []
    assert ship == Ship(2, "Fram", True, Engine("steam", 50.0), ["Oslo", "Bergen"])
    assert type(ship.engine.power) is float
    with pytest.raises(FrozenInstanceError):
        ship.masts = 3
    with pytest.raises(FrozenInstanceError):
        ship.engine.kind = "diesel"


def test_flatten_gives_every_value_under_its_dotted_key():
    assert flatten(build(Ship, GOOD, [])) == {
        "masts": 2,
        "name": "Fram",
        "flagged": True,
        "engine.kind": "steam",
        "engine.power": 50.0,
        "ports": ["Oslo", "Bergen"],
    }


@pytest.mark.parametrize(
    ("hint", "value"),
    [
        (int, 8.0),
        (int, True),
        (int, None),
        (int, "eight"),
        (int, [8]),
        (bool, 1),
        (str, 3),
        (float, "fast"),
        (float, True),
        (Annotated[int, Range(1, 1000)], 0),
        (Annotated[float, Range(0, 1)], float("nan")),
        (Annotated[float, Range()], float("inf")),
        (Annotated[float, Range(0, 1e30)], int("9" * 400)),
        (Literal["a", "b"], "c"),
        (Literal["a", "b"], ["a"]),
        (list[Literal["a", "b"]], []),
        (list[Literal["a", "b"]], ["a", "a"]),
        (list[int], 3),
        (int | list[int], ["3"]),
    ],
)
def test_a_value_of_another_type_or_range_is_refused(hint, value):
    with pytest.raises((ValueError, TypeError, OverflowError)):
        convert(value, hint)


@pytest.mark.parametrize("value", ["5e-4", "5.0E-4", 0.0005])
def test_a_number_may_be_written_with_or_without_a_point(value):
    assert convert(value, float) == 0.0005


def test_a_union_takes_the_first_type_that_fits():
    assert convert(3, int | list[int]) == 3 and convert([3, 2], int | list[int]) == [3, 2]


@pytest.mark.parametrize(
    ("hint", "words"),
    [
        (Annotated[int, Range(1, 9)], "an integer in [1, 9]"),
        (Literal["a", "b"], "a | b"),
        (list[Literal["a", "b"]], "a list of a | b"),
        (int | list[float], "an integer or a list of a number"),
        (bool, "true or false"),
        (Engine, "a section"),
    ],
)
def test_a_type_is_described_in_words(hint, words):
    assert describe(hint) == words


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"masts": 4}, ("masts is 4", "[0, 3]")),
        ({"engine": {"kind": "steem", "power": 1}}, ("engine.kind is 'steem'", "did you mean steam?")),
        ({"engine": {"kind": 7, "power": 1}}, ("engine.kind is 7", "steam | diesel")),
        ({"engine": {"kind": "steam", "power": 0}}, ("engine.power is 0", "(0, 100]")),
        ({"engine": "steam"}, ("engine is 'steam'", "section")),
        ({"engine": {"kind": "steam"}}, ("missing key engine.power", "a number")),
        ({"mast": 2}, ("unknown key mast;", "did you mean masts?")),
        ({"zzz": 2}, ("unknown key zzz;", "known here: masts, name")),
    ],
)
def test_a_mistake_names_its_key_and_what_is_allowed(change, words):
    (mistake,) = mistakes_of(GOOD | change)
    assert all(word in mistake for word in words), mistake


def test_all_mistakes_are_listed_at_once():
    mistakes = mistakes_of({"masts": 9, "flagged": 1, "engine": {"kind": "steam"}, "ports": "all", "colour": "red"})
    assert len(mistakes) == 5
    for start in ("unknown key colour", "masts is 9", "flagged is 1", "missing key engine.power", "missing key name"):
        assert sum(mistake.startswith(start) for mistake in mistakes) == 1


def test_a_value_is_set_under_its_dotted_key():
    tree = {"engine": {"kind": "steam"}}
    assert set_value(tree, "engine.power=5.5") is None and set_value(tree, "ports=[a, b]") is None
    assert tree == {"engine": {"kind": "steam", "power": 5.5}, "ports": ["a", "b"]}


@pytest.mark.parametrize(
    ("change", "word"), [("masts", "key=value"), ("masts.count=3", "no section"), ("masts=[1", "YAML")]
)
def test_a_change_that_cannot_be_made_is_named(change, word):
    mistake = set_value({"masts": 2}, change)
    assert "masts" in mistake and word in mistake


@settings(max_examples=100, deadline=None)
@given(st.floats(), st.sampled_from(["", "low", "high", "both"]))
def test_a_range_holds_what_its_inequalities_hold(x, without):
    inside = {
        "": -1 <= x <= 2,
        "low": -1 < x <= 2,
        "high": -1 <= x < 2,
        "both": -1 < x < 2,
    }
    assert (x in Range(-1, 2, open=without)) == inside[without]


@pytest.mark.parametrize(
    ("ends", "text"),
    [
        ((0, 1), "in [0, 1]"),
        ((0, 1, "high"), "in [0, 1)"),
        ((0, 1, "both"), "in (0, 1)"),
        ((), "in (-inf, inf)"),
        ((0, 4294967295), "in [0, 4294967295]"),
    ],
)
def test_a_range_is_written_as_in_mathematics(ends, text):
    assert str(Range(*ends)) == text


@pytest.mark.parametrize(
    "value, text",
    [
        ("kmeans", "kmeans"),
        ("data/my_glove-2.h5", "data/my_glove-2.h5"),
        ("data/glöve 16", '"data/glöve 16"'),
        ('it\'s "b", #1 & {c}: $d', '"it\'s \\"b\\", #1 & {c}: $d"'),
        ("12", '"12"'),
        ("true", '"true"'),
        (True, "true"),
        (None, "null"),
        (8, "8"),
        (150.0, "150"),
        (0.1234567891234567, "0.1234567891234567"),
        (1e-05, "1e-05"),
        (["ball", "a b", 3], '[ball,"a b",3]'),
        ([{"name": "pin", "weight": 2.5}], "[{name: pin, weight: 2.5}]"),
    ],
)
def test_a_change_is_read_back_the_same_by_params_yaml_and_by_dvc_s_own_parser(value, text):
    parser = pytest.importorskip("hydra.core.override_parser.overrides_parser").OverridesParser.create()
    change, tree = as_change("key", value), {}
    assert change == f"key={text}"
    assert set_value(tree, change) is None
    read = float(tree["key"]) if isinstance(value, float) else tree["key"]  # PyYAML reads 1e-05 as text
    assert read == value == unquoted(parser.parse_override(change).value())


def unquoted(value):
    """A value of Hydra's parser as plain values."""
    if isinstance(value, list):
        return [unquoted(one) for one in value]
    if isinstance(value, dict):
        return {unquoted(name): unquoted(one) for name, one in value.items()}
    return getattr(value, "text", value)


def test_a_value_that_yaml_has_not_is_no_change():
    with pytest.raises(UserError, match="key is <object"):
        as_change("key", object())


@pytest.mark.parametrize(
    "text, allowed", [("python -m", True), ("a b  -m ", True), ("-m", False), ("", False), ("a m", False)]
)
def test_a_text_may_have_to_end_in_a_word_after_others(text, allowed):
    hint = Annotated[str, EndingIn("-m")]
    assert describe(hint) == "a text of several words that ends in -m"
    if allowed:
        assert convert(text, hint) == text
    else:
        with pytest.raises(ValueError):
            convert(text, hint)
