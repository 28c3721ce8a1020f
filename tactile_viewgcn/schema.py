"""Makes typed objects from YAML and `key=value` changes, and lists every mistake in them."""

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
        raise ValueError("an item appears twice")
    return items


Unique = AfterValidator(_unique)


class _Loader(yaml.SafeLoader):
    """YAML in which 1e-3 is a number, as DVC reads it."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+$"), [*"-+0123456789"]
)


def parse(text: str | bytes, name: object) -> Any:
    """Return the values of a YAML text.

    Args:
        text: the YAML.
        name: the first word of an error.

    Raises:
        UserError: the text is no YAML.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:MOST_SHOWN]
        raise UserError(f"{name}: this is no YAML: {reason}") from None


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the keys and values of a YAML file.

    Args:
        path: of the file.

    Raises:
        UserError: the file holds something else.
        OSError: the file cannot be read.
    """
    check_is_file(path)
    tree = parse(path.read_bytes(), path)
    if isinstance(tree, dict):
        return tree
    found = type(tree).__name__
    if tree is None:
        found = "nothing"
    raise UserError(f"{path}: expected keys and values, found {found}")


def build(kind: Any, tree: dict[str, Any], name: str, changes: tuple[str, ...] = ()) -> Any:
    """Return an object of a dataclass, with its values checked.

    Args:
        kind: the dataclass.
        tree: its values, as a mapping of mappings.
        name: the first word of an error.
        changes: `key=value` texts that replace values.

    Raises:
        UserError: there are mistakes. The message begins with `name` and lists each mistake with
            its key, pydantic's message and the value. For a misspelt key or choice it has the
            nearest known one.
    """
    mistakes = list[str]()
    for change in changes:
        try:
            set_value(tree, change)
        except UserError as error:
            mistakes.append(str(error))
    try:
        built = TypeAdapter(kind).validate_python(tree)
    except ValidationError as error:
        keys = list(_keys(kind))
        mistakes += [_mistake(keys, details) for details in error.errors(include_url=False)]
    if mistakes:
        raise UserError(f"{name}: " + "; ".join(mistakes))
    return built


def _mistake(keys: list[str], error: ErrorDetails) -> str:
    """Return one of pydantic's errors in words, with its value and its key, one of `keys`."""
    key = ".".join(map(str, error["loc"]))
    text = error["msg"].removeprefix("Value error, ")
    if error["type"] == "unexpected_keyword_argument":
        return f"unknown key {key}{nearest(key, keys)}"
    while key and key not in keys:  # pydantic's place can lie in a list or a branch of a union
        key = key.rpartition(".")[0]
    if not key:
        return text
    value = error["input"]
    choices = re.findall("'(.*?)'", error.get("ctx", {}).get("expected", ""))
    return f"{key}: {text} (got {repr(value)[:MOST_SHOWN]}){nearest(value, choices)}"


def nearest(word: Any, words: Iterable[str]) -> str:
    """Return `; did you mean ...?` with the known word that is most similar to a word.

    Args:
        word: the word that a user wrote.
        words: the known words.

    Returns:
        The question; empty if no known word is similar.
    """
    near = get_close_matches(str(word), words, n=1)
    if not near:
        return ""
    return f"; did you mean {near[0]}?"


def _keys(kind: Any, prefix: str = "") -> Iterator[str]:
    """Yield the dotted keys of a dataclass and of its sections."""
    for field in fields(kind):
        yield prefix + field.name
        if is_dataclass(field.type):
            yield from _keys(field.type, f"{prefix}{field.name}.")


def flatten(section: Any, prefix: str = "") -> dict[str, Any]:
    """Return every value of an object by its dotted key, such as {"cluster.method": "kmeans"}.

    Args:
        section: an object with sections as attributes, or a mapping of mappings.
        prefix: the beginning of every key.
    """
    if isinstance(section, dict):
        parts = section
    elif hasattr(section, "__dict__"):
        parts = vars(section)
    else:
        return {prefix.removesuffix("."): section}
    values: dict[str, Any] = {}
    for name, value in parts.items():
        values |= flatten(value, f"{prefix}{name}.")
    return values


def set_value(tree: dict[str, Any], change: str) -> None:
    """Set `section.key=value` in a mapping of mappings.

    Args:
        tree: the mapping.
        change: the text; its value is read as YAML.

    Raises:
        UserError: the text is no `key=value`.
    """
    key, equals, text = change.partition("=")
    if not equals:
        raise UserError(f"--set {change!r}: expected key=value")
    *sections, name = key.split(".")
    for section in sections:
        if not isinstance(tree.get(section), dict):
            tree[section] = {}  # its type is refused later, if it is no section
        tree = tree[section]
    tree[name] = parse(text, f"--set {change[:MOST_SHOWN]!r}")


def as_change(key: str, value: Any) -> str:
    """Return `key=value` as `dvc exp run -S` and `set_value` read it, with every digit.

    Args:
        key: the dotted key.
        value: the value, which is written like [3,3,2], true, 0.001, a_word or "two words".
    """
    if isinstance(value, str) and _is_plain_word(value, key):
        return f"{key}={value}"
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"), default=str)
    return f"{key}={text}"


def _is_plain_word(value: str, key: str) -> bool:
    """Return whether a text needs no quotes in a shell and is also read as a text in YAML."""
    is_word = re.fullmatch(r"[\w/.-]+", value, re.ASCII) is not None
    return is_word and isinstance(parse(value, key), str)
