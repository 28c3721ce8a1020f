"""Files with random damage are soon read or refused in one line, whatever the libraries do."""

import numpy as np
import pytest
from scipy import io

from tactile_viewgcn.readers.source import Form
from tests.readers.files import COUNTS, record, refusal, save
from tests.stag_files import metadata, save_matlab5, save_matlab73

INPUTS = 25  # damaged files of each kind
WORDS = [0, 1, 127, 2**15, 2**16 - 1, 2**31 - 1, 2**32 - 1, 2**62, 2**64 - 1]  # wrong sizes
NAMED = b"time_ms,label,trial,a,b\n0,mug,1,5,6\n9,mug,1,5,7\n0,pen,1,8,6\n"


def tree():
    fields = metadata(objects=2, recordings=1, frames=4)
    return fields | {"pressure": fields["pressure"][:, :3, 12:16]}


def own_matlab(path):
    io.savemat(path, {"emg": COUNTS, "unit": "mV"}, do_compression=True)
    return path


KINDS = {  # the name of a file, and a function that makes a good one
    "HDF5": (
        "a.h5",
        lambda path: record(path, time=np.arange(4.0), valid=np.ones(4, bool), grasp=np.arange(4)),
    ),
    "MATLAB 5": ("metadata.mat", lambda path: save_matlab5(path, tree())),
    "MATLAB 7.3": ("metadata.mat", lambda path: save_matlab73(path, tree())),
    "MATLAB of one's own": ("1.mat", own_matlab),
    ".npz": ("1.npz", lambda path: save(path, {"pressure": COUNTS, "time": np.arange(4.0)})),
    ".csv": ("1.csv", lambda path: save(path, NAMED)),
}


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Return bytes with one to six faults: lost, doubled or moved pieces, and wrong numbers."""
    content = bytearray(data)
    for _ in range(rng.integers(1, 7)):
        start, other = rng.integers(max(1, len(content)), size=2).tolist()
        end = start + int(2 ** rng.uniform(0, 8))
        number = WORDS[rng.integers(len(WORDS))]
        word = number.to_bytes(8, "little")[: 2 ** int(rng.integers(4))]
        match rng.integers(4):
            case 0:
                del content[start:end]
            case 1:
                content[start:start] = content[start:end]
            case 2:
                content[start:end] = content[other : other + end - start]
            case _:
                content[start : start + len(word)] = word
    return bytes(content)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_is_read_or_refused_in_one_line(kind, tmp_path):
    name, make = KINDS[kind]
    (tmp_path / "in").mkdir()
    path = tmp_path / "in" / name
    good = make(path).read_bytes()
    assert refusal(path, tmp_path, form=Form(labelled=False)) == ""
    lines = []
    for seed in range(INPUTS):
        path.write_bytes(damaged(good, np.random.default_rng([seed, *kind.encode()])))
        # `refusal` asserts that reading ends in time and leaves nothing behind
        lines.append(refusal(path, tmp_path, form=Form(labelled=False)))
    refused = [line for line in lines if line]
    assert refused
    assert all(str(path) in line for line in refused)
