"""Damaged inputs, one after another, in a separate process, which a crash of a library ends.

`python -m tests.readers.fuzz KIND FIRST LAST FOLDER` prints the outcome of each input as a line of JSON.
"""

import gzip
import json
import re
import resource
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from shutil import rmtree

import h5py
import numpy as np
from scipy import io

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import load
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.recognition.mlflow_model import RecogniserModel
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.recordings import read_source
from tests.glove_data import recipe, table, trained
from tests.readers.files import COUNTS, record
from tests.stag_files import metadata, save_matlab73

MEMORY = 2**30  # most bytes for one input
WORDS = [0, 1, 2, 8, 127, 2**15, 2**16 - 1, 2**31 - 1, 2**32 - 1, 2**40, 2**62, 2**64 - 1]  # wrong sizes
TEXTS = [*b'-1 1e400 true null [ ] {} " NaN'.split(), b"9" * 400, b"&a *a", b"\x1b[2J", b"\xff", b"\n"]
NAMES = {"matlab5": "metadata.mat", "matlab73": "metadata.mat"}
NAMES |= {kind: f"1.{kind}" for kind in ("npy", "npz", "csv", "mat")}
MADE_OF_TEXT = ("csv", "params", "server")


def good_bytes(kind: str, folder: Path) -> list[bytes]:
    """Contents of undamaged files of a kind."""
    path = folder / "good.h5"
    tree = metadata(objects=2, recordings=1, frames=4)
    tree["pressure"] = tree["pressure"][:, :3, 12:16]
    if kind == "hdf5":
        record(path, time=np.arange(4.0), valid=np.ones(4, bool), grasp=np.arange(4))
        linked = record(folder / "linked.h5", pressure=None)
        with h5py.File(linked, "r+") as file:
            file.create_dataset("raw/counts", data=COUNTS, chunks=(2, 5, 7), compression="gzip", shuffle=True)
            file["pressure"] = h5py.SoftLink("/raw/counts")
        return [path.read_bytes(), linked.read_bytes()]
    if kind == "matlab5":
        for packed in (False, True):
            io.savemat(folder / f"{packed}.mat", tree, do_compression=packed)
        return [(folder / "False.mat").read_bytes(), (folder / "True.mat").read_bytes()]
    if kind == "mat":
        io.savemat(folder / "1.mat", {"emg": COUNTS, "unit": "mV"}, do_compression=True)
        later = record(folder / "later.mat", pressure=None, emg=COUNTS, rate=7.35)
        return [(folder / "1.mat").read_bytes(), later.read_bytes()]
    if kind == "matlab73":
        return [save_matlab73(folder / "good.mat", tree).read_bytes()]
    if kind == "npy":
        np.save(folder / "good.npy", COUNTS)
        return [(folder / "good.npy").read_bytes()]
    if kind == "npz":
        np.savez(folder / "plain.npz", COUNTS)
        np.savez_compressed(folder / "packed.npz", pressure=COUNTS, time=np.arange(4.0))
        return [(folder / "plain.npz").read_bytes(), (folder / "packed.npz").read_bytes()]
    if kind == "csv":
        named = b"time_ms,label,trial,a,b\n0,mug,1,5,6\n9,mug,1,5,7\n0,pen,1,8,6\n"
        others = [b"# a b\n1,5 2\n3 4,5\n", "1\t2,5\r\n3\t4\r\n".encode("utf-16"), named, gzip.compress(named)]
        return [b"a,b,c\n1,2,3\n4,5,6\n7,8,9\n", b"1;2.5;3\n4;5;-6e3\n", *others]
    if kind == "params":
        return [Path("params.yaml").read_bytes()]
    return [json.dumps({"counts": table().counts[:8].reshape(2, 4, 12, 12).tolist(), "session": "000"}).encode()]


def damaged(data: bytes, rng: np.random.Generator, is_text: bool) -> bytes:
    """The bytes with one to six faults: bits, numbers, words of a text, pieces removed, doubled or moved."""
    out = bytearray(data)
    for _ in range(rng.integers(1, 7)):
        at, length = int(rng.integers(max(1, len(out)))), int(2 ** rng.uniform(0, 8))
        match rng.choice([0, 1, 2, 3] if is_text else [0, 0, 0, 1, 2, 3, 3, 4, 4, 4, 5, 5, 5]):
            case 0 if is_text:
                numbers = [*re.finditer(rb"[\w.+-]+", out)] or [re.match(b"", out)]
                place = numbers[rng.integers(len(numbers))]
                out[place.start() : place.end()] = TEXTS[rng.integers(len(TEXTS))]
            case 0:
                out[at : at + 1] = bytes([int(rng.integers(256))])
            case 1:
                del out[at : at + length]
            case 2:
                out[at:at] = out[at : at + length]
            case 3:
                other = int(rng.integers(max(1, len(out))))
                out[at : at + length] = out[other : other + length]
            case 4:
                size = int(rng.choice([1, 2, 4, 8]))
                word = int(WORDS[rng.integers(len(WORDS))]) % 2 ** (8 * size)
                out[at - at % size : at - at % size + size] = word.to_bytes(size, "little")
            case _:
                out[at : at + 1] = bytes([(out[at] if at < len(out) else 0) ^ 1 << int(rng.integers(8))])
    return bytes(out[: rng.integers(len(out) + 1)] if rng.random() < 0.05 else out)


def reader(kind: str, folder: Path) -> Callable[[bytes], None]:
    """The function that reads an input of a kind."""
    if kind == "server":
        save_classifier(folder / "classifier.pt", trained(), recipe().model, table())
        model = RecogniserModel(Recogniser(folder / "classifier.pt"))
        return lambda data: ask(model, data)
    path = folder / "in" / NAMES.get(kind, "a.h5")
    path.parent.mkdir()

    def read(data: bytes) -> None:
        path.write_bytes(data)
        if kind == "params":
            load(path)
        else:
            form = Form(labelled=kind not in ("npy", "npz", "csv", "mat"))
            read_source(path, folder / "out" / "table", form=form)

    return read


def ask(model: RecogniserModel, data: bytes) -> None:
    """Give a request to the model as MLflow does, which refuses anything but JSON by itself."""
    from mlflow.exceptions import MlflowException

    try:
        request = json.loads(data)
        counts = np.array(request["counts"], dtype=object)
        params = {"session": str(request["session"])}
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise UserError(f"MLflow: {type(error).__name__}") from None
    try:
        model.predict({"counts": counts}, params)
    except MlflowException as error:
        raise UserError(json.loads(error.serialize_as_json())["message"]) from None


def outcome(read: Callable[[bytes], None], data: bytes, left: Path) -> dict:
    """Whether an input was read or refused, or a fault; with its line, its seconds and the files that it left."""
    begin, result = time.perf_counter(), {"outcome": "read"}
    try:
        read(data)
    except UserError as error:
        result = {"outcome": "refused", "line": str(error)}
    except BaseException:
        result = {"outcome": "fault", "line": traceback.format_exc()}
    if result["outcome"] == "read":
        rmtree(left / "table", ignore_errors=True)
    return result | {"seconds": time.perf_counter() - begin, "left": [path.name for path in left.iterdir()]}


def main(kind: str, first: str, last: str, place: str) -> None:
    folder = Path(place)
    (folder / "out").mkdir(parents=True)
    read, whole = reader(kind, folder), good_bytes(kind, folder)
    for data in whole:
        read(data)  # which also imports everything before memory is counted
        rmtree(folder / "out" / "table", ignore_errors=True)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, size + MEMORY))
    for number in range(int(first), int(last)):
        rng = np.random.default_rng([number, *kind.encode()])
        print(json.dumps({"number": number}), flush=True)  # all that is known of an input that crashes
        data = damaged(whole[number % len(whole)], rng, kind in MADE_OF_TEXT)
        result = outcome(read, data, folder / "out") | {"number": number}
        print(json.dumps(result), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
