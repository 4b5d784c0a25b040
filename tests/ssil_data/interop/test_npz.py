"""NumPy's files are read without unpickling, or refused."""

import zipfile
from pathlib import Path

import numpy as np

from ssil_data.interop import Layout, read_columns
from support.foreign_files import (
    encode_member,
    read_episodes,
    refuse,
    write_npz,
)


def test_pickled_objects_are_never_loaded(shared_data: Path):
    columns = read_columns(shared_data / "expert" / "imitation_cartpole.npz")
    assert "infos" not in columns
    assert "acts" in columns
    assert len(read_episodes(columns.path, Layout(state=("acts",), action=("acts",))).episodes) == 1
    message = refuse(columns.path, Layout(state=("infos",), action=("acts",)))
    assert "expected numbers or text in column 'infos', found Python objects" in message


def test_usual_arrays_of_python_objects_are_refused(tmp_path: Path):
    objects = np.array([{}, {}, {}, {}], dtype=object)
    assert "column 'labeled'" in refuse(write_npz(tmp_path, labeled=objects), Layout())


def test_bytes_are_text_in_utf8_or_refused(tmp_path: Path):
    tiers = np.array(["bëst".encode()] * 4)
    assert read_episodes(write_npz(tmp_path, tier=tiers), Layout()).episodes[0].tier == "bëst"
    message = refuse(write_npz(tmp_path, tier=np.array([b"\xff"] * 4)), Layout())
    assert "column 'tier', found bytes that are not UTF-8 text" in message


def test_a_corrupt_deflate_stream_is_refused(tmp_path: Path):
    path = tmp_path / "deflated.npz"
    np.savez_compressed(path, states=np.random.default_rng(0).normal(size=(200, 3)))
    data = bytearray(path.read_bytes())
    for seed in range(30):
        broken = bytearray(data)
        for place in np.random.default_rng(seed).integers(60, len(data) - 120, 20):
            broken[place] ^= 0xFF
        path.write_bytes(broken)
        assert "cannot be read as a NumPy file" in refuse(path, Layout())


def test_an_encrypted_archive_is_refused(tmp_path: Path):
    path = write_npz(tmp_path)
    data = bytearray(path.read_bytes())
    for signature, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        place = data.find(signature)
        while place >= 0:
            data[place + flags] |= 1
            place = data.find(signature, place + 1)
    path.write_bytes(data)
    assert "encrypted" in refuse(path, Layout())


def test_a_member_that_is_no_array_is_refused_only_when_asked_for(tmp_path: Path):
    path = write_npz(tmp_path)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("notes.txt", "hello")
    assert len(read_episodes(path, Layout()).episodes) == 1
    assert "found a member that is no NumPy array" in refuse(path, Layout(state=("notes.txt",)))


def test_a_header_that_claims_more_rows_than_fit_is_refused(tmp_path: Path):
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**13, 2)}
    member = encode_member(np.ones(4), header=header)
    (tmp_path / "huge.npy").write_bytes(member)
    assert "cannot be read as a NumPy file" in refuse(tmp_path / "huge.npy", Layout())
    with zipfile.ZipFile(tmp_path / "huge.npz", "w") as archive:
        archive.writestr("states.npy", member)
    assert "cannot be read as a NumPy file" in refuse(tmp_path / "huge.npz", Layout())
