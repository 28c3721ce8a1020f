"""Typed objects from YAML, with every mistake listed in pydantic's words; `key=value` changes to a mapping."""

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml
from pydantic import AfterValidator, ConfigDict, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from tactile_viewgcn.files import check_is_file
from tactile_viewgcn.messages import UserError

SECTION = ConfigDict(extra="forbid", allow_inf_nan=False)
MOST_SHOWN = 200  # letters of a wrong value or of a parser's message


def _unique(items: list[Any]) -> list[Any]:
    if len(set(map(str, items))) < len(items):
        raise ValueError("an item stands twice")
    return items


Unique = AfterValidator(_unique)


class _Loader(yaml.SafeLoader):
    """YAML in which 1e-3 is a number, as DVC reads it."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+$"), [*"-+0123456789"]
)


def parse(text: str | bytes, name: object) -> Any:
    """The values of a YAML text; a UserError that begins with `name` where it is none."""
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise UserError(f"{name}: no YAML: {' '.join(str(error).split())[:MOST_SHOWN]}") from None


def read_yaml(path: Path) -> dict[str, Any]:
    """The keys and values of a YAML file; a UserError where it holds anything else."""
    check_is_file(path)
    tree = parse(path.read_bytes(), path)
    if not isinstance(tree, dict):
        raise UserError(
            f"{path}: expected keys and values, found {'nothing' if tree is None else type(tree).__name__}"
        )
    return tree


def build(kind: Any, tree: dict[str, Any], name: str, changes: tuple[str, ...] = ()) -> Any:
    """An object of the dataclass `kind` from a mapping with `key=value` changes on top.

    Raises:
        UserError: begins with `name` and lists every mistake, each with its key, pydantic's message
            and the value; of a misspelt key or choice the nearest known one.
    """
    mistakes = []
    for change in changes:
        try:
            set_value(tree, change)
        except UserError as error:
            mistakes.append(str(error))
    try:
        built = TypeAdapter(kind).validate_python(tree)
    except ValidationError as error:
        mistakes += [_mistake(list(_keys(kind)), one) for one in error.errors(include_url=False)]
    if mistakes:
        raise UserError(f"{name}: " + "; ".join(mistakes))
    return built


def _mistake(keys: list[str], error: ErrorDetails) -> str:
    """One of pydantic's errors with the key it is about, one of `keys`, and the value."""
    key, text = ".".join(map(str, error["loc"])), error["msg"].removeprefix("Value error, ")
    if error["type"] == "unexpected_keyword_argument":
        return f"unknown key {key}{nearest(key, keys)}"
    while key and key not in keys:  # pydantic goes on into a list or to a branch of a union
        key = key.rpartition(".")[0]
    if not key:
        return text
    choices = re.findall("'(.*?)'", error.get("ctx", {}).get("expected", ""))
    return (
        f"{key}: {text} (got {repr(error['input'])[:MOST_SHOWN]}){nearest(error['input'], choices)}"
    )


def nearest(word: Any, words: Iterable[str]) -> str:
    """`; did you mean ...?` with the known word that is most like this one; empty if none is."""
    near = get_close_matches(str(word), words, n=1)
    return f"; did you mean {near[0]}?" if near else ""


def _keys(kind: Any, prefix: str = "") -> Iterator[str]:
    """The dotted keys of a dataclass and of its sections."""
    for field in fields(kind):
        yield prefix + field.name
        if is_dataclass(field.type):
            yield from _keys(field.type, f"{prefix}{field.name}.")


def flatten(section: Any, prefix: str = "") -> dict[str, Any]:
    """Every value of an object or of a mapping of mappings under its dotted key: {"cluster.method": "kmeans"}."""
    if not isinstance(section, dict) and not hasattr(section, "__dict__"):
        return {prefix.removesuffix("."): section}
    values: dict[str, Any] = {}
    for name, value in (section if isinstance(section, dict) else vars(section)).items():
        values |= flatten(value, f"{prefix}{name}.")
    return values


def set_value(tree: dict[str, Any], change: str) -> None:
    """Set `section.key=value` in a mapping of mappings; a UserError where that cannot be done."""
    key, equals, text = change.partition("=")
    if not equals:
        raise UserError(f"--set {change!r}: expected key=value")
    *sections, name = key.split(".")
    for section in sections:
        if not isinstance(tree.get(section), dict):
            tree[section] = {}  # refused by its type, if it is no section
        tree = tree[section]
    tree[name] = parse(text, f"--set {change[:MOST_SHOWN]!r}")


def as_change(key: str, value: Any) -> str:
    """`key=value` as `dvc exp run -S` and `set_value` read it, with every digit: [3,3,2], true, 0.001, "two words"."""
    if (
        isinstance(value, str)
        and re.fullmatch(r"[\w/.-]+", value, re.ASCII)
        and isinstance(parse(value, key), str)
    ):
        return f"{key}={value}"
    return f"{key}={json.dumps(value, ensure_ascii=False, separators=(',', ':'), default=str)}"
