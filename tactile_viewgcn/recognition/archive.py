"""Fitted estimators as archives of skops: no code runs when one is read, and nothing in it is believed unseen."""

import io
import json
import zipfile
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np
import torch
from torch import Tensor

ARCHIVE = "skops"  # key of a pipeline's bytes, uint8 (n,)
OURS = [
    "tactile_viewgcn.sensors.forest.Forest",
    "tactile_viewgcn.sensors.kernels.BlockMeans",
    "tactile_viewgcn.sensors.kernels.KernelClassifier",
    "tactile_viewgcn.sensors.support_vectors.SupportVectors",
]
SCIKIT_LEARN = {"Pipeline", "LogisticRegression", "PCA", "LinearDiscriminantAnalysis"}
PLAIN = {f"builtins.{name}" for name in ("dict", "list", "tuple", "str", "int", "float", "bool")}
NUMBERS = {f"numpy.{name}" for name in ("ndarray", "float32", "float64", "int32", "int64")}


def packed(value: Any) -> Any:
    """Dictionaries and lists with tensors contiguous on the processor, and estimators as archives."""
    if isinstance(value, dict):
        return {name: packed(part) for name, part in value.items()}
    if isinstance(value, list):
        return [packed(part) for part in value]
    if isinstance(value, Tensor):
        return value.cpu().contiguous()
    if isinstance(value, int | float | str | None):
        return value
    return {ARCHIVE: torch.frombuffer(bytearray(archive_of(value)), dtype=torch.uint8)}


def archive_of(estimator: Any) -> bytes:
    """The estimator as an archive of skops, with the same bytes for equal ones.

    skops names parts by their places in memory and dates them; here they are numbered in their order, without a date.
    """
    from skops.io import dumps

    numbers: dict[int, int] = {}
    files: dict[str, str] = {}

    def renamed(node: dict[str, Any]) -> dict[str, Any]:
        if "__id__" in node:
            node["__id__"] = numbers.setdefault(node["__id__"], len(numbers))
        if "file" in node:
            node["file"] = files.setdefault(node["file"], f"{len(files)}.npy")
        return node

    with zipfile.ZipFile(io.BytesIO(dumps(estimator))) as old, zipfile.ZipFile(data := io.BytesIO(), "w") as new:
        schema = json.loads(old.read("schema.json"), object_hook=renamed)
        for place, name in files.items():
            new.writestr(zipfile.ZipInfo(name), old.read(place))
        new.writestr(zipfile.ZipInfo("schema.json"), json.dumps(schema))
    return data.getvalue()


def unpacked(value: Any) -> Any:
    """The reverse of `packed`."""
    if isinstance(value, dict) and value.keys() == {ARCHIVE}:
        return read_archive(value[ARCHIVE].numpy().tobytes())
    if isinstance(value, dict):
        return {name: unpacked(part) for name, part in value.items()}
    return [unpacked(part) for part in value] if isinstance(value, list) else value


def read_archive(data: bytes) -> Any:
    """The pipeline in an archive of skops.

    Raises:
        ValueError: it names a type that no pipeline of ours has, is larger unpacked than packed, a number in it is not
            finite, or an index leads outside its arrays.
    """
    from skops.io import loads

    check_packed(io.BytesIO(data), len(data))
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        schema = json.loads(archive.read("schema.json"))
        sizes = {member.filename: member.file_size for member in archive.infolist()}
        arrays = (np.load(archive.open(name), allow_pickle=False) for name in sizes if name.endswith(".npy"))
        finite = all(np.isfinite(array).all() for array in arrays if array.dtype.kind == "f")
    if not finite or {"NaN", "Infinity", "-Infinity"} & {str(content) for content in values(schema, "content")}:
        raise ValueError("a pipeline's number is not finite")
    foreign = sorted(set(_types(schema)) - {*OURS, *PLAIN, *NUMBERS})
    foreign = [name for name in foreign if not (name.startswith("sklearn.") and name.split(".")[-1] in SCIKIT_LEARN)]
    if foreign:
        raise ValueError(f"a pipeline of type {', '.join(foreign)} is not trusted")
    if sum(sizes.get(name, 0) for name in values(schema, "file")) > len(data):
        raise ValueError("a pipeline's archive names an array many times")
    return loads(data, trusted=OURS)


def _types(schema: Any) -> Iterator[str]:
    """The names of all types in a schema of skops."""
    if isinstance(schema, dict) and "__class__" in schema:
        yield f"{schema['__module__']}.{schema['__class__']}"
    for part in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
        yield from _types(part)


def values(node: Any, key: str) -> Iterator[Any]:
    """The values of a key in dictionaries and lists, wherever it stands."""
    if isinstance(node, dict):
        if key in node:
            yield node[key]
        for part in node.values():
            yield from values(part, key)
    elif isinstance(node, list):
        for part in node:
            yield from values(part, key)


def check_packed(stream: BinaryIO, size: int) -> None:
    """A ValueError where an archive of so many bytes holds more of them: a small file would fill the memory."""
    with zipfile.ZipFile(stream) as archive:
        if sum(member.file_size for member in archive.infolist()) > size:
            raise ValueError("its archive is compressed, or names a part many times")
