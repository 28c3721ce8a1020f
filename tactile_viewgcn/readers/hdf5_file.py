"""Opening HDF5 files of recordings, which may come from anybody.

No link out of a file is followed, nor within it to what is no plain dataset; what a dataset declares is checked against
what the file stores before any of it is read.
"""

import math
import mmap
import struct
import zlib
from pathlib import Path

import h5py

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import check_is_file, readable_source
from tactile_viewgcn.readers.limits import check_size
from tactile_viewgcn.readers.source import MOST_LETTERS

MOST_CHUNK = 64 * 2**20  # bytes of a chunk, which is read whole, and kept for the next block
MOST_SMALL, SMALL = 2**18, 1024  # chunks of fewer bytes, each of which takes HDF5 a kilobyte and a while
CAREFUL = 2**15  # bytes stored of a chunk, above which gzip is tried before HDF5 inflates it, by 1,032 at most
MOST_LZF = 2**23  # likewise, of lzf, which inflates by 90 at most
SLACK = 64  # bytes that filters may add
HEAP = b"GCOL\1\0\0\0"  # how one begins
GZIP, LZF = h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_LZF
CHECKS = h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32
NUMBERS, OBJECTS = "biuf", "O"  # kinds of dtype; the latter of texts and references
DATASET, GROUP, OUTWARD = "dataset", "group", "link to another file"
NOWHERE = "link that leads nowhere in the file"
DAMAGED = "not a readable HDF5 file, or cut short"
AGAIN = "record or download it again"


def open_hdf5(path: Path) -> h5py.File:
    """An HDF5 file, open for reading; a UserError where it is no such file, or cut short."""
    check_is_file(path)
    with readable_source(path, DAMAGED, AGAIN):
        return h5py.File(path, "r", rdcc_nbytes=MOST_CHUNK)


def check_heaps(file: h5py.File) -> None:
    """Raise a ValueError where HDF5 would not end: a heap has a part without a size.

    Heaps hold texts, and what virtual datasets are made of. All of the file is read.
    """
    if file.id.get_create_plist().get_sizes() != (8, 8):
        raise ValueError("its addresses are not of eight bytes")
    with Path(file.filename).open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        place, parts, most = content.find(HEAP), 0, len(content) // 16  # bytes of a part's header
        while place >= 0:
            (size,) = struct.unpack_from("<Q", content, place + len(HEAP))
            at, end = place + 16, min(place + size, len(content))
            while at + 16 <= end:
                index, length = struct.unpack_from("<H6xQ", content, at)
                parts += 1
                if length > size or not (index or length) or parts > most:
                    raise ValueError("a heap of texts is damaged")
                at += 16 + length + -length % 8 if index else length
            place = content.find(HEAP, place + 1)


def attribute_names(path: Path) -> set[str]:
    """Names of the attributes on the root of an HDF5 file; none of another file, or of one that is cut short."""
    try:
        with open_hdf5(path) as file, readable_source(path, DAMAGED, AGAIN):
            return set(file.attrs)
    except UserError:
        return set()


def attribute(file: h5py.File, name: str) -> str | None:
    """An attribute of the root as text, None where there is none; a UserError where it is no single text or number.

    `check_heaps` comes first.
    """
    if name not in file.attrs:
        return None
    stored = file.attrs.get_id(name)
    is_text = h5py.check_string_dtype(stored.dtype) is not None
    single = math.prod(stored.shape or (0,) * (stored.shape is None)) == 1 and stored.dtype.itemsize <= 4 * MOST_LETTERS
    if not single or not (is_text or stored.dtype.kind in NUMBERS):
        raise UserError(f"{file.filename}: attribute {name} is no single text; expected one, as for a recording")
    value = file.attrs[name]
    value = value if isinstance(value, str | bytes) else value.ravel()[0] if value.shape else value
    return value.decode() if isinstance(value, bytes) else str(value)


def kind_of(file: h5py.File, name: str) -> str:
    """What stands under a name in the root: `dataset`, `group`, or which link that is not followed."""
    link = file.get(name, getlink=True)
    if isinstance(link, h5py.ExternalLink):
        return OUTWARD
    if isinstance(link, h5py.SoftLink) and not _leads_to_object(file, link.path):
        return NOWHERE
    return DATASET if isinstance(file[name], h5py.Dataset) else GROUP


def _leads_to_object(file: h5py.File, target: str) -> bool:
    """Whether a path from the root passes through groups of the file alone, and no further link."""
    place = file
    for part in filter(None, target.split("/")):
        if not isinstance(place, h5py.Group) or not isinstance(place.get(part, getlink=True), h5py.HardLink):
            return False
        place = place[part]
    return True


def dataset(file: h5py.File, name: str, kinds: str = NUMBERS) -> h5py.Dataset:
    """A dataset in the root whose values can be read without harm; their dtype is of one of the kinds.

    Raises:
        UserError: it is another object, or `check_dataset` refuses it.
    """
    if (kind := kind_of(file, name)) != DATASET:
        raise UserError(f"{file.filename}: /{name} is a {kind}; expected a dataset in the file itself")
    check_dataset(file[name], f"{file.filename}: /{name}", kinds)
    return file[name]


def check_dataset(values: h5py.Dataset, where: str, kinds: str = NUMBERS) -> None:
    """Raise a UserError, whose message begins with `where`, for a dataset that is not to be read.

    Its values lie outside the file, are no numbers, are compressed in a way of which is not known how far they inflate,
    or are far more than what is stored.
    """
    if values.is_virtual or values.external:
        raise UserError(f"{where} has its values outside the file; expected them in it")
    is_object = h5py.check_string_dtype(values.dtype) or h5py.check_ref_dtype(values.dtype) is h5py.Reference
    if values.shape is None or values.dtype.kind not in kinds or (values.dtype.kind == OBJECTS and not is_object):
        kind = "null" if values.shape is None else values.dtype
        raise UserError(f"{where} is of type {kind}; expected integers or real numbers")
    stored = min(values.id.get_storage_size(), Path(values.file.filename).stat().st_size)
    declared = math.prod(values.shape) * values.dtype.itemsize
    check_size(declared, stored, where)
    if values.chunks:
        _check_chunks(values, where)


def _check_chunks(values: h5py.Dataset, where: str) -> None:
    """The same for the size of chunks, and how they are compressed."""
    size = math.prod(values.chunks) * values.dtype.itemsize
    if size > MOST_CHUNK:
        raise UserError(f"{where} has chunks of {size / 1e6:,.0f} MB; expected at most {MOST_CHUNK / 1e6:,.0f} MB")
    count = math.prod(-(-side // part) for side, part in zip(values.shape, values.chunks, strict=True))
    if size < SMALL and count > MOST_SMALL:
        raise UserError(
            f"{where} is cut into {count:,} chunks of {size} bytes; expected {SMALL:,} bytes or more in each: "
            "write it again in larger ones (h5repack -l)"
        )
    properties = values.id.get_create_plist()
    filters = [properties.get_filter(number)[0] for number in range(properties.get_nfilters())]
    compressed = [code for code in filters if code not in CHECKS]
    if len(compressed) > 1 or not set(compressed) <= {GZIP, LZF}:
        raise UserError(f"{where} is compressed by HDF5's filters {compressed}; expected one of gzip and lzf, or none")
    if not compressed:
        return
    chunks: list[h5py.h5d.StoreInfo] = []
    values.id.chunk_iter(lambda chunk: chunks.append(chunk))
    left_out = 1 << filters.index(compressed[0])  # of a chunk that does not become smaller
    chunks = [chunk for chunk in chunks if not chunk.filter_mask & left_out]
    if LZF in filters and any(chunk.size > MOST_LZF for chunk in chunks):
        most = MOST_LZF / 1e6
        raise UserError(f"{where} has chunks of more than {most:,.0f} MB in lzf; expected smaller ones, or gzip")
    if any(_inflates(values, chunk, size, filters) for chunk in chunks):
        raise UserError(f"{where} has a chunk that inflates to more than its {size / 1e6:,.3f} MB; record it again")


def _inflates(values: h5py.Dataset, chunk: h5py.h5d.StoreInfo, size: int, filters: list[int]) -> bool:
    """Whether a chunk may become far more than its size, which HDF5 would go on with; gzip is tried, where it could."""
    if chunk.size > size + size // 16 + SLACK:
        return True
    if chunk.size <= CAREFUL or LZF in filters:
        return False
    stored = values.id.read_direct_chunk(chunk.chunk_offset)[1]
    return len(zlib.decompressobj().decompress(stored, size + SLACK + 1)) > size + SLACK
