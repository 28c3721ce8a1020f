"""Typed objects from YAML: pydantic checks, every mistake is put in words; `key=value` changes to a mapping.

A section is a frozen dataclass of pydantic; a key has one of the types below, a Literal, a list, or a union of these.
"""

import math
import re
from dataclasses import is_dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import yaml
from annotated_types import Interval
from pydantic import AfterValidator, ConfigDict, Strict, TypeAdapter, ValidationError

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import check_is_file

SECTION = ConfigDict(extra="forbid", allow_inf_nan=False)
Integer = Annotated[int, Strict()]
Number = Annotated[float, Strict()]
Text = Annotated[str, Strict()]
Truth = Annotated[bool, Strict()]
WORDS = {int: "an integer", float: "a number", bool: "true or false", str: "a text", dict: "a mapping"}
MOST_BYTES = 2**20  # of a file
MOST_VALUES = 10_000  # in a file, each counted as often as aliases repeat it
DEEPEST = 30  # lists and mappings within each other
MOST_SHOWN = 200  # characters of a wrong value


def _unique(items: list[Any]) -> list[Any]:
    if len(set(map(str, items))) < len(items):
        raise ValueError("an item stands twice")
    return items


Unique = AfterValidator(_unique)


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]  # in C where it is built
    """YAML in which 5e-4 is a number, though it has no point, and in which a key stands once."""


_Loader.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$"),
                              list("-+0123456789"))  # fmt: skip


def parse(text: str | bytes) -> Any:
    """The values of a YAML text.

    Raises:
        ValueError: it is not YAML, has a key twice, nests deeper than DEEPEST, or has more than MOST_VALUES values.
    """
    try:
        depth = 0
        for number, event in enumerate(yaml.parse(text, Loader=_Loader)):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:  # composing recurses, in C without a limit
                raise ValueError(f"values nested more than {DEEPEST} deep")
            if number > MOST_VALUES:
                raise ValueError(f"more than {MOST_VALUES:,} values")
        loader = _Loader(text)
        node = loader.get_single_node()
        if node is not None and _count(node, {}) > MOST_VALUES:
            raise ValueError(f"more than {MOST_VALUES:,} values, aliases written out")
        return None if node is None else _constructed(loader, node)
    except yaml.YAMLError as error:
        raise ValueError(f"not YAML: {' '.join(str(error).split())}") from None


def _constructed(loader: _Loader, node: yaml.Node) -> Any:
    try:
        return loader.construct_document(node)
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError):  # a tag that the value is not of
        raise ValueError("not YAML: a value does not go with its tag") from None


def _count(node: yaml.Node, counts: dict[int, float]) -> float:
    """Number of values under a node, aliases written out; infinite where one contains itself."""
    if id(node) not in counts:
        counts[id(node)] = math.inf
        children = node.value if isinstance(node, yaml.SequenceNode) else []
        if isinstance(node, yaml.MappingNode):
            children = [child for pair in node.value for child in pair]
            keys: set[str] = set()
            for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
                if key.value in keys:
                    raise ValueError(f"key {key.value} stands twice, again in line {key.start_mark.line + 1}")
                keys.add(key.value)
        counts[id(node)] = 1 + sum(_count(child, counts) for child in children)
    return counts[id(node)]


def read_yaml(path: Path) -> dict[str, Any]:
    """The keys and values of a YAML file.

    Raises:
        UserError: as `parse`; or it holds something else than keys and values, such as nothing.
        FileNotFoundError: no such file.
    """
    check_is_file(path)
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ValueError(f"more than {MOST_BYTES:,} bytes")
        tree = parse(path.read_bytes())
    except ValueError as error:
        raise UserError(f"{path}: {error}") from None
    if not isinstance(tree, dict):
        raise UserError(f"{path}: expected keys and values, found {'nothing' if tree is None else type(tree).__name__}")
    return tree


def build(kind: Any, tree: dict[str, Any], name: str, changes: tuple[str, ...] = ()) -> Any:
    """An object of the dataclass `kind` from a mapping with `key=value` changes on top.

    Raises:
        UserError: begins with `name` and lists every mistake, each with its key, the value, what is allowed, and the
            nearest known name of a misspelt one.
    """
    mistakes = [mistake for change in changes if (mistake := set_value(tree, change))]
    try:
        built = TypeAdapter(kind).validate_python(tree)
    except ValidationError as error:
        errors = error.errors(include_url=False, include_input=False)
        once = {(_place(kind, one["loc"]), one["type"] == "missing"): one for one in reversed(errors)}.values()
        mistakes += sorted({_in_words(kind, tree, one["type"], one["loc"], one["msg"]) for one in once})
    if mistakes:
        raise UserError(f"{name}: " + "; ".join(mistakes))
    return built


def _place(kind: Any, place: tuple[int | str, ...]) -> tuple[int | str, ...]:
    """The keys of a place down to the value: what follows, in a list or a union, is named as a whole."""
    for number, key in enumerate(place):
        if not is_dataclass(kind):
            return place[:number]
        kind = get_type_hints(kind, include_extras=True).get(str(key))
    return place


def _in_words(kind: Any, value: Any, error: str, place: tuple[int | str, ...], message: str) -> str:
    """A mistake of pydantic at a place in a mapping; its message where it is about several keys."""
    hint, path = kind, []
    for key in place:
        if not is_dataclass(hint):
            break  # within a list or a union: the whole value is named
        hints = get_type_hints(hint, include_extras=True)
        path.append(str(key))
        if key not in hints:
            near = get_close_matches(str(key), hints, n=1, cutoff=0.5)
            section = "".join(f"{part}." for part in path[:-1])
            known = f"did you mean {section}{near[0]}?" if near else f"known here: {', '.join(hints)}"
            return f"unknown key {'.'.join(path)}; {known}"
        hint = hints[str(key)]
        value = value.get(key) if error != "missing" else None
    if not path:
        return message.removeprefix("Value error, ")
    if error == "missing":
        return f"missing key {'.'.join(path)}; expected {describe(hint)}"
    allowed = get_args(hint) if get_origin(hint) is Literal else ()
    near = get_close_matches(_shown(value).strip("'"), allowed, n=1, cutoff=0.6)
    meant = f" (did you mean {near[0]}?)" if near else ""
    return f"{'.'.join(path)} is {_shown(value)}; expected {describe(hint)}{meant}"


def _shown(value: Any) -> str:
    try:
        shown = repr(value)
    except ValueError:  # Python writes no integer of more than 4,300 digits
        return "a number of thousands of digits"
    return shown if len(shown) <= MOST_SHOWN else f"{shown[:MOST_SHOWN]}..."


def describe(hint: Any) -> str:
    """What a type allows, in words; of `Annotated` a text in it."""
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        words = next((item for item in args[1:] if isinstance(item, str)), describe(args[0]))
        return " ".join([words, *(_range(item) for item in args[1:] if isinstance(item, Interval))])
    if origin is Literal:
        return " | ".join(args)
    if origin is list:
        return f"a list of {describe(args[0])}"
    if args and hint not in WORDS:
        return " or ".join(map(describe, args))
    return "a section with keys" if is_dataclass(hint) else WORDS[hint]


def _range(interval: Interval) -> str:
    low, high = (next((end for end in ends if end is not None), None) for ends in (
        (interval.ge, interval.gt), (interval.le, interval.lt)))  # fmt: skip
    left = "(-inf" if low is None else f"{'[' if interval.gt is None else '('}{low:.10g}"
    right = "inf)" if high is None else f"{high:.10g}{']' if interval.lt is None else ')'}"
    return f"in {left}, {right}"


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
    if len(sections) > DEEPEST:
        return f"--set {key[:MOST_SHOWN]}: sections nested more than {DEEPEST} deep"
    for section in sections:
        tree = tree.setdefault(section, {})
        if not isinstance(tree, dict):
            return f"--set {key}: {section} is no section"
    try:
        tree[name] = parse(text)
    except ValueError:
        return f"--set {key}: {_shown(text)} is not YAML"
    return None


def as_change(key: str, value: Any) -> str:
    """`key=value` as `dvc exp run -S` and `set_value` read it: [3,3,2], true, 0.001, "two words"; no digit is lost.

    Raises:
        UserError: YAML has no such value.
    """
    try:
        return f"{key}={_written(value)}"
    except TypeError:
        raise UserError(
            f"{key} is {_shown(value)}; expected a text, a number, true, false, or a list of these"
        ) from None


def _written(value: Any) -> str:
    """A value of YAML in the words that Hydra, which reads DVC's changes, has in common with it."""
    if isinstance(value, list):
        return f"[{','.join(map(_written, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{name}: {_written(one)}' for name, one in value.items())}}}"
    if isinstance(value, str):
        if re.fullmatch(r"[\w/.-]+", value, re.ASCII) and isinstance(parse(value), str):
            return value
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value).removesuffix(".0")
    if value is None:
        return "null"
    raise TypeError(value)
