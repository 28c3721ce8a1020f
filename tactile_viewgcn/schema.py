"""Typed objects from YAML, with every mistake listed in pydantic's words; `key=value` changes to a mapping."""

import json
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from functools import reduce
from pathlib import Path
from typing import Any

import yaml
from pydantic import AfterValidator, ConfigDict, TypeAdapter, ValidationError

from tactile_viewgcn.files import check_is_file
from tactile_viewgcn.messages import UserError

SECTION = ConfigDict(extra="forbid", allow_inf_nan=False)
MOST_TEXT = 2**16  # bytes of a file, or characters of a value
MOST_SHOWN = 200  # characters of a wrong value
MISSING: Any = object()


def _unique(items: list[Any]) -> list[Any]:
    if len(set(map(str, items))) < len(items):
        raise ValueError("an item stands twice")
    return items


Unique = AfterValidator(_unique)


class _Loader(yaml.SafeLoader):
    """YAML 1.2 as DVC reads it, with decimal numbers alone: 1:30 and `on` are texts; no key twice, and no alias."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise ValueError("an alias; write the value out")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        counts = Counter(key.value for key, _ in node.value)
        if twice := [key for key in counts if counts[key] > 1]:
            raise ValueError(f"key {twice[0]} stands twice")
        return super().construct_mapping(node, deep)


_Loader.yaml_implicit_resolvers = {}  # in place of those of YAML 1.1
for tag, pattern in {
    "null": "~|null|Null|NULL|",
    "bool": "true|True|TRUE|false|False|FALSE",
    "int": "[-+]?[0-9][0-9_]*",
    "float": r"[-+]?(\.[0-9]+|[0-9][0-9_]*(\.[0-9]*)?)([eE][-+]?[0-9]+)?",
}.items():
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{tag}", re.compile(f"({pattern})$"), None)
_Loader.add_constructor("tag:yaml.org,2002:int", lambda _, node: int(node.value))  # PyYAML's own reads base 60
_Loader.add_constructor("tag:yaml.org,2002:float", lambda _, node: float(node.value))


def parse(text: str | bytes) -> Any:
    """The values of a YAML text.

    Raises:
        ValueError: it is not YAML, or too long, or too deep for Python, or has a repeated key or an alias.
    """
    if len(text) > MOST_TEXT:
        raise ValueError(f"longer than {MOST_TEXT:,} characters")
    try:
        return yaml.load(text, Loader=_Loader)
    except Exception as error:  # a value that contradicts its tag may raise any exception
        raise ValueError(f"no plain YAML: {' '.join(str(error).split())[:MOST_SHOWN]}") from None


def read_yaml(path: Path) -> dict[str, Any]:
    """The keys and values of a YAML file.

    Raises:
        UserError: as `parse`, or it does not hold keys and values.
        FileNotFoundError: no such file.
    """
    check_is_file(path)
    try:
        with path.open("rb") as file:
            tree = parse(file.read(MOST_TEXT + 1))
    except ValueError as error:
        raise UserError(f"{path}: {error}") from None
    if not isinstance(tree, dict):
        raise UserError(f"{path}: expected keys and values, found {'nothing' if tree is None else type(tree).__name__}")
    return tree


def build(kind: Any, tree: dict[str, Any], name: str, changes: tuple[str, ...] = ()) -> Any:
    """An object of the dataclass `kind` from a mapping with `key=value` changes on top.

    Raises:
        UserError: begins with `name` and lists every mistake, each with its key, pydantic's message and the value; of a
            misspelt key the nearest known one.
    """
    mistakes = [mistake for change in changes if (mistake := set_value(tree, change))]
    try:
        built = TypeAdapter(kind).validate_python(tree)
    except ValidationError as error:
        mistakes += _mistakes(kind, tree, error)
    if mistakes:
        raise UserError(f"{name}: " + "; ".join(mistakes))
    return built


def _mistakes(kind: Any, tree: dict[str, Any], error: ValidationError) -> list[str]:
    """Pydantic's messages, those of one key joined, each with the key and its value."""
    keys, mistakes = list(_keys(kind)), []
    messages: dict[tuple[str, ...], dict[str, None]] = {}
    for one in error.errors(include_url=False, include_input=False):
        place = tuple(map(str, one["loc"]))
        if one["type"] == "unexpected_keyword_argument":
            near = get_close_matches(".".join(place), keys, n=1)
            mistakes.append(f"unknown key {'.'.join(place)}" + (f"; did you mean {near[0]}?" if near else ""))
            continue
        while place and ".".join(place) not in keys:  # the place is inside a list or a union
            place = place[:-1]
        messages.setdefault(place, {})[one["msg"].removeprefix("Value error, ")] = None
    for place, texts in messages.items():
        text = " or ".join(texts).replace(" or Input should be ", " or ")
        value = reduce(lambda section, key: section.get(key, MISSING), place, tree) if place else MISSING
        shown = "" if value is MISSING else f" (got {repr(value)[:MOST_SHOWN]})"
        mistakes.append(f"{'.'.join(place)}: {text}{shown}" if place else text)
    return mistakes


def _keys(kind: Any, prefix: str = "") -> Iterator[str]:
    """The dotted keys of a dataclass, with those of its sections."""
    for field in fields(kind):
        yield prefix + field.name
        if is_dataclass(field.type):
            yield from _keys(field.type, f"{prefix}{field.name}.")


def flatten(section: Any, prefix: str = "") -> dict[str, Any]:
    """Every value of a dataclass, or of a mapping of mappings, under its dotted key: {"cluster.method": "kmeans"}."""
    values: dict[str, Any] = {}
    for name, value in (section if isinstance(section, dict) else vars(section)).items():
        nested = isinstance(value, dict) or is_dataclass(value)
        values |= flatten(value, f"{prefix}{name}.") if nested else {prefix + name: value}
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
        tree[name] = parse(text)
    except ValueError as error:
        return f"--set {key}: {text[:MOST_SHOWN]!r} is {error}"
    return None


def as_change(key: str, value: Any) -> str:
    """`key=value` as `dvc exp run -S` and `set_value` read it, with every digit: [3,3,2], true, 0.001, "two words".

    Raises:
        UserError: YAML has no such value.
    """
    try:
        return f"{key}={_written(value)}"
    except TypeError:
        raise UserError(f"{key}: {value!r} cannot be written as YAML") from None


def _written(value: Any) -> str:
    """A value in the syntax that YAML and Hydra, which reads DVC's changes, have in common."""
    if isinstance(value, list):
        return f"[{','.join(map(_written, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{name}: {_written(one)}' for name, one in value.items())}}}"
    if isinstance(value, str) and re.fullmatch(r"[\w/.-]+", value, re.ASCII) and isinstance(parse(value), str):
        return value
    if isinstance(value, str) and "\\" in value and "'" not in value and value.isprintable() and value[-1] != "\\":
        return f"'{value}'"  # Hydra reads a backslash as it stands, but before a quote, and YAML so in single quotes
    return json.dumps(value, ensure_ascii=False).removesuffix(".0")
