"""Frozen dataclasses built from a mapping of YAML, with every mistake listed.

A field's type says what it may hold: int, float, bool, str, dict, a Literal of texts, a list, a union, another
dataclass (a section), or `Annotated` with a `Range` or an `EndingIn`. There are no defaults: every key has to be there.
"""

import math
import re
from dataclasses import dataclass, fields, is_dataclass
from difflib import get_close_matches
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import yaml

from tactile_viewgcn.errors import UserError

TYPE_NAMES = {
    int: "an integer",
    float: "a number",
    bool: "true or false",
    str: "a text",
    dict: "a mapping",
    type(None): "null",
}


@dataclass(frozen=True)
class Range:
    """Allowed numbers: low <= x <= high, without the ends that `open` names ("low", "high" or "both")."""

    low: float = -math.inf
    high: float = math.inf
    open: str = ""

    def __contains__(self, x: float) -> bool:
        above = x > self.low if self.open in ("low", "both") else x >= self.low
        below = x < self.high if self.open in ("high", "both") else x <= self.high
        return above and below and math.isfinite(x)

    def __str__(self) -> str:
        left = "(" if self.open in ("low", "both") or math.isinf(self.low) else "["
        right = ")" if self.open in ("high", "both") or math.isinf(self.high) else "]"
        return f"in {left}{self.low:.10g}, {self.high:.10g}{right}"


@dataclass(frozen=True)
class EndingIn:
    """Allowed texts: of several words, the last of which is this one."""

    word: str

    def __contains__(self, text: str) -> bool:
        *before, last = text.split() or [""]
        return bool(before) and last == self.word

    def __str__(self) -> str:
        return f"of several words that ends in {self.word}"


def flatten(section: Any, prefix: str = "") -> dict[str, Any]:
    """Every value of a dataclass under its dotted key, for example {"cluster.method": "kmeans"}."""
    values: dict[str, Any] = {}
    for field in fields(section):
        value, key = getattr(section, field.name), prefix + field.name
        values |= flatten(value, key + ".") if is_dataclass(value) else {key: value}
    return values


def set_value(tree: dict[str, Any], change: str) -> str | None:
    """Set `section.key=value` in a mapping of mappings; returns the mistake where that cannot be done."""
    key, equals, text = change.partition("=")
    if not equals:
        return f"--set {change!r}: expected key=value"
    *sections, name = key.split(".")
    for section in sections:
        tree = tree.setdefault(section, {})
        if not isinstance(tree, dict):
            return f"--set {key}: {section} is no section"
    try:
        tree[name] = yaml.safe_load(text)
    except yaml.YAMLError:
        return f"--set {key}: {text!r} is not YAML"
    return None


def as_change(key: str, value: Any) -> str:
    """`key=value` as `dvc exp run -S` and `set_value` read it: [3,3,2], true, 0.001, "two words"; no digit is lost.

    Raises:
        UserError: YAML has no such value.
    """
    try:
        return f"{key}={_written(value)}"
    except TypeError:
        raise UserError(f"{key} is {value!r}; expected a text, a number, true, false, or a list of these") from None


def _written(value: Any) -> str:
    """A value of YAML in the words that Hydra, which reads DVC's changes, has in common with it."""
    if isinstance(value, list):
        return f"[{','.join(map(_written, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{name}: {_written(one)}' for name, one in value.items())}}}"
    if isinstance(value, str):
        if re.fullmatch(r"[\w/.-]+", value, re.ASCII) and isinstance(yaml.safe_load(value), str):
            return value
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value).removesuffix(".0")
    if value is None:
        return "null"
    raise TypeError(value)


def build(kind: Any, tree: dict[str, Any], mistakes: list[str], prefix: str = "") -> Any:
    """An object of the dataclass `kind` from a mapping; None where that fails, and the mistakes are appended.

    A mistake names the dotted key, the value, what is allowed, and the nearest known name of a misspelt one.
    """
    hints, here = get_type_hints(kind, include_extras=True), []
    for key in tree.keys() - hints.keys():
        near = get_close_matches(str(key), hints, n=1, cutoff=0.5)
        known = f"did you mean {prefix}{near[0]}?" if near else f"known here: {', '.join(hints)}"
        here.append(f"unknown key {prefix}{key}; {known}")
    values = {}
    for key, hint in hints.items():
        if key not in tree:
            here.append(f"missing key {prefix}{key}; expected {describe(hint)}")
        elif not is_dataclass(hint):
            try:
                values[key] = convert(tree[key], hint)
            except (ValueError, TypeError, OverflowError):
                here.append(f"{prefix}{key} is {tree[key]!r}; expected {describe(hint)}{_suggestion(tree[key], hint)}")
        elif isinstance(tree[key], dict):
            values[key] = build(hint, tree[key], here, f"{prefix}{key}.")
        else:
            here.append(f"{prefix}{key} is {tree[key]!r}; expected a section with keys")
    mistakes += sorted(here)
    return None if here else kind(**values)


def convert(value: Any, hint: Any) -> Any:
    """`value` as the type that `hint` names.

    Raises:
        ValueError, TypeError, OverflowError: it is of another type, or not among the allowed values.
    """
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        converted = convert(value, args[0])
        if converted not in args[1]:
            raise ValueError(value)
        return converted
    if origin is Literal:
        if not isinstance(value, str) or value not in args:
            raise ValueError(value)
        return value
    if origin is list:
        if not isinstance(value, list) or not value:
            raise TypeError(value)
        items = [convert(item, args[0]) for item in value]
        if get_origin(args[0]) is Literal and len(set(items)) < len(items):
            raise ValueError(value)
        return items
    if args:
        return _first_that_fits(value, args)
    if hint is float and (isinstance(value, str) or type(value) is int):
        return float(value)  # PyYAML reads 5e-4, which has no point, as text
    if type(value) is not hint:
        raise TypeError(value)
    return value


def describe(hint: Any) -> str:
    """What a type allows, in words."""
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return f"{describe(args[0])} {args[1]}"
    if origin is Literal:
        return " | ".join(args)
    if origin is list:
        return f"a list of {describe(args[0])}"
    if args:
        return " or ".join(map(describe, args))
    return "a section" if is_dataclass(hint) else TYPE_NAMES[hint]


def _first_that_fits(value: Any, choices: tuple[Any, ...]) -> Any:
    """`value` as the first type of a union that takes it."""
    for choice in choices:
        try:
            return convert(value, choice)
        except (ValueError, TypeError, OverflowError):
            continue
    raise ValueError(value)


def _suggestion(value: Any, hint: Any) -> str:
    """The allowed text that a misspelt one is nearest to, as a question in brackets."""
    near = get_close_matches(str(value), get_args(hint) if get_origin(hint) is Literal else (), n=1, cutoff=0.6)
    return f" (did you mean {near[0]}?)" if near else ""
