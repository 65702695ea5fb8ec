"""Readers of files: whatever a file holds, it is read right or refused with one family of errors, in bounded time."""

import io
import json
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pcm_gym
from pcm_gym.mechanism import mechanism_from_json, mechanism_to_json
from pcm_gym.solving import atlas_file
from tests.boundary.doors import atlas

DEEP = 100_000


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("atlas") / "sound.npz"
    atlas().save(path)
    return path.read_bytes()


def arrays_of(content: bytes) -> dict[str, Any]:
    with np.load(io.BytesIO(content)) as archive:
        return {name: archive[name] for name in archive.files}


def packed(arrays: dict[str, Any]) -> bytes:
    file = io.BytesIO()
    np.savez(file, allow_pickle=True, **arrays)
    return file.getvalue()


def broken_atlases(sound: bytes) -> Iterator[tuple[str, bytes]]:
    numbers = np.random.default_rng(0)
    yield "empty", b""
    yield "text", b"no atlas"
    yield "one array", _saved(np.zeros(3))
    for length in numbers.integers(1, len(sound), 40):
        yield f"cut at {length}", sound[:length]
    for _ in range(150):
        changed = bytearray(sound)
        place = int(numbers.integers(len(changed)))
        changed[place] ^= 1 << int(numbers.integers(8))
        yield f"bit at {place}", bytes(changed)
    whole = arrays_of(sound)
    for name, array in whole.items():
        yield f"without {name}", packed({key: own for key, own in whole.items() if key != name})
        wrongs: dict[str, Any] = {"objects": np.array([object()]), "text": np.array("x"), "none": np.empty(0)}
        wrongs |= {"nan": np.full(array.shape, np.nan), "deep": np.zeros((1,) * 5), "complex": np.array([1j])}
        if array.dtype.kind in "if":
            wrongs |= {"raised": array + array.dtype.type(10**9), "negative": -1 - array}
        for kind, wrong in wrongs.items():
            yield f"{name} {kind}", packed(whole | {name: wrong})
    yield "version of another kind", packed(whole | {"version": np.arange(3)})
    yield "nested text", packed(whole | {"mechanism": np.array("[" * DEEP)})
    yield "long number", packed(whole | {"mechanism": np.array('{"legs": ' + "9" * 5000 + "}")})
    for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        yield f"compressed by {method}", _zipped({"format.npy": b"no array"}, method)
    yield "huge by its header", _zipped({"format.npy": _header((1 << 50,))})
    yield "nested header", _zipped({"format.npy": _header("(" * DEEP)})
    yield "encrypted", _flagged(sound)


def test_a_damaged_atlas_is_an_atlas_error(sound: bytes, tmp_path: Path) -> None:
    path, read, refused = tmp_path / "broken.npz", 0, 0
    for name, content in broken_atlases(sound):
        path.write_bytes(content)
        begin = time.perf_counter()
        refusal = refusal_of(pcm_gym.load_atlas, path)
        if refusal is None:  # it has been hurt where that does not matter
            assert len(pcm_gym.load_atlas(path).branches) < 1000, name
            read += 1
        else:
            assert isinstance(refusal, pcm_gym.AtlasError), name
            assert str(path) in str(refusal), name
            refused += 1
        assert time.perf_counter() - begin < 10.0, name
    assert refused > 200
    assert read < refused / 4


def test_what_unpacks_to_more_than_an_atlas_is_refused_unread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert 100 * sum(array.nbytes for array in vars(atlas().over_poses).values() if np.ndim(array)) < atlas_file.LARGEST
    monkeypatch.setattr(atlas_file, "LARGEST", 1 << 20)
    monkeypatch.setattr(np.lib.npyio, "NpzFile", None)
    path = tmp_path / "bomb.npz"
    path.write_bytes(_zipped({"format.npy": bytes(1 << 24)}, zipfile.ZIP_DEFLATED))
    assert path.stat().st_size < 1 << 15
    with pytest.raises(pcm_gym.AtlasError, match=f"holds {1 << 24} bytes, and an atlas at most {1 << 20}"):
        pcm_gym.load_atlas(path)


def test_what_is_no_file_is_an_atlas_error_too(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nothing", "\0"):
        with pytest.raises(pcm_gym.AtlasError):
            pcm_gym.load_atlas(path)
    with pytest.raises(FileNotFoundError):
        pcm_gym.load_atlas(tmp_path / "nothing")


def test_mechanisms_as_text_are_read_or_refused() -> None:
    text = mechanism_to_json(pcm_gym.get_mechanism("3PFR"))
    wrongs = [
        "",
        "null",
        "[]",
        "{}",
        "[" * DEEP,
        "9" * 5000,
        "NaN",
        text[:-1],
        text.replace('"length": 1.0', '"length": NaN'),
    ]
    for key in json.loads(text):
        value: Any
        for value in (None, 1, [], {}, "x", True):
            changed = json.loads(text) | {key: value}
            if key not in ("description", "home_pose", "home_inputs", "reference") or value not in (None, "x"):
                wrongs.append(json.dumps(changed))
    for wrong in wrongs:
        refusal = refusal_of(mechanism_from_json, wrong)
        assert refusal is None or "does not describe a mechanism" in str(refusal)


def refusal_of(read: Any, source: Any) -> ValueError | None:
    """The error with which a source is refused; any other kind of error passes."""
    try:
        read(source)
    except ValueError as error:
        return error
    return None


def _saved(array: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def _header(shape: Any) -> bytes:
    """An array file with this shape in its header, and nothing behind it."""
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x02\x00" + len(text).to_bytes(4, "little") + text


def _zipped(entries: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    return file.getvalue()


def _flagged(sound: bytes) -> bytes:
    """The file, with each entry said to be encrypted."""
    changed = bytearray(sound)
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        place = changed.find(signature)
        while place >= 0:
            changed[place + offset] |= 1
            place = changed.find(signature, place + 4)
    return bytes(changed)
