"""Files from outside: only regular ones are opened, and no more is read than was asked for."""

from __future__ import annotations

import errno
import io
import os
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from colony.files import (
    ClaimedError,
    FileClaim,
    UnsuitableFileError,
    bounded_lines,
    claim_holder,
    keep_in_cache,
    open_descriptor,
    open_regular,
    own_folder,
    read_all,
    read_file,
    read_from_cache,
    reason,
    size_text,
)


def pipe(path: Path) -> None:
    os.mkfifo(path)


def a_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


STRANGE: list[tuple[Callable[[Path], None], str]] = [
    (pipe, "it is not a regular file"),
    (a_socket, "it is not a regular file"),
    (device, "it is not a regular file"),
    (Path.mkdir, "Is a directory"),
]


@pytest.mark.parametrize(("make", "why"), STRANGE, ids=[make.__name__ for make, _ in STRANGE])
def test_what_is_no_regular_file_is_refused(tmp_path: Path, make: Callable[[Path], None], why: str) -> None:
    path = tmp_path / "file"
    make(path)
    for flags in (os.O_RDONLY, os.O_RDWR, os.O_RDWR | os.O_CREAT):
        with pytest.raises(UnsuitableFileError) as refused:
            open_descriptor(path, flags)
        assert refused.value.strerror == reason(refused.value) == why
        assert refused.value.filename == path


@pytest.mark.parametrize("path", ["", "none", "a\0b", "a" * 5000, "\ud800"])
def test_names_without_a_file(path: str) -> None:
    with pytest.raises(OSError, match=r"\[Errno") as refused:
        open_regular(path)
    assert reason(refused.value)


def test_a_link_to_a_file_is_followed_unless_it_is_not_to_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"abc")
    (tmp_path / "link").symlink_to("file")
    assert read_file(tmp_path / "link", 3) == b"abc"
    with pytest.raises(UnsuitableFileError, match="not a regular file"):
        open_descriptor(tmp_path / "link", os.O_RDONLY | os.O_NOFOLLOW)


def test_a_file_is_made_where_that_is_asked_for(tmp_path: Path) -> None:
    descriptor = open_descriptor(tmp_path / "new", os.O_RDWR | os.O_CREAT)
    assert os.fstat(descriptor).st_mode & 0o777 == 0o600
    assert not os.get_inheritable(descriptor)
    os.close(descriptor)


@pytest.mark.parametrize("most", [0, 1, 9, 1 << 20, (1 << 20) + 1])
def test_a_file_is_read_up_to_its_limit(tmp_path: Path, most: int) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x" * most)
    assert read_file(path, most) == b"x" * most
    path.write_bytes(b"x" * (most + 1))
    with pytest.raises(UnsuitableFileError) as refused:
        read_file(path, most)
    assert refused.value.errno == errno.EFBIG
    assert refused.value.strerror == f"it is larger than {size_text(most)}"


def test_a_file_that_grows_while_it_is_read(tmp_path: Path) -> None:
    class Growing(io.FileIO):
        def read(self, size: int | None = -1, /) -> bytes:
            with path.open("ab") as other:
                other.write(b"x" * 1000)
            return super().read(size) or b""

    path = tmp_path / "file"
    path.write_bytes(b"x")
    with Growing(path) as file, pytest.raises(UnsuitableFileError, match="larger than 5000 bytes"):
        read_all(file, 5000, path)  # type: ignore[arg-type]


def test_lines_come_with_their_ends_and_are_bounded() -> None:
    lines = bounded_lines(io.BytesIO(b"ab\n\nabc\n" + b"x" * 4), 4)
    assert list(lines) == [b"ab\n", b"\n", b"abc\n", b"xxxx"]
    lines = bounded_lines(io.BytesIO(b"ab\nabcd\nz"), 4)
    assert next(lines) == b"ab\n"
    with pytest.raises(UnsuitableFileError, match="line 2 is longer than 4 bytes"):
        next(lines)


def test_sizes_in_words() -> None:
    sizes = (4 << 20, 3 << 10, 4_000_000, 5)
    assert [size_text(n) for n in sizes] == ["4 MiB", "3 KiB", "4 MB", "5 bytes"]


@pytest.fixture
def open_to_all() -> Iterator[None]:
    """Let what the test creates be writable by all users."""
    before = os.umask(0)
    yield
    os.umask(before)


@pytest.mark.usefixtures("open_to_all")
def test_an_own_folder_and_those_around_it_are_of_the_user_alone(tmp_path: Path) -> None:
    own_folder(tmp_path / "a" / "b")
    assert [(tmp_path / name).stat().st_mode & 0o777 for name in ("a", "a/b")] == [0o700, 0o700]
    own_folder(tmp_path / "a" / "b")


def test_a_file_of_the_cache_that_others_can_write_to_is_not_read(tmp_path: Path) -> None:
    path, link = tmp_path / "own" / "file", tmp_path / "own" / "link"
    keep_in_cache(path, b"ours")
    link.symlink_to(path)
    with pytest.raises(UnsuitableFileError, match="not a regular file"):
        read_from_cache(link, 4)
    for mode in (0o620, 0o602):
        path.chmod(mode)
        with pytest.raises(UnsuitableFileError, match="not of this user alone"):
            read_from_cache(path, 4)
    keep_in_cache(path, b"ours")
    assert read_from_cache(path, 4) == b"ours"


@pytest.mark.parametrize(
    ("outer", "inner", "is_own"),
    [
        (0o755, 0o755, True),
        (0o775, 0o700, True),
        (0o1777, 0o700, True),
        (0o777, 0o700, False),
        (0o755, 0o775, False),
        (0o755, 0o757, False),
        (0o755, 0o1777, False),
    ],
)
def test_a_cache_is_not_used_in_a_folder_that_other_users_can_write_to(
    tmp_path: Path, outer: int, inner: int, is_own: bool
) -> None:
    path = tmp_path / "outer" / "inner" / "file"
    keep_in_cache(path, b"ours")
    path.parent.chmod(inner)
    path.parents[1].chmod(outer)
    if is_own:
        keep_in_cache(path, b"still")
        assert read_from_cache(path, 5) == b"still"
        return
    for use in (lambda: keep_in_cache(path, b"no"), lambda: read_from_cache(path, 4)):
        with pytest.raises(UnsuitableFileError, match="user"):
            use()
    assert path.read_bytes() == b"ours"


def test_a_folder_of_another_user_or_without_a_place_is_not_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(UnsuitableFileError, match="absolute"):
        own_folder(Path("~/.cache"))
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with pytest.raises(UnsuitableFileError, match="user"):
        own_folder(tmp_path)


@pytest.mark.parametrize("name", ["outer", "link"])
def test_a_folder_is_not_own_if_another_user_owns_one_above_it_or_a_link_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    path = tmp_path / "link" / "inner"
    (tmp_path / "outer").mkdir()
    (tmp_path / "link").symlink_to("outer")
    own_folder(path)
    (tmp_path / "outer").chmod(0o1777)
    own_folder(path)
    status_of = os.stat

    def status(of: str | Path, **options: bool) -> os.stat_result:
        found = status_of(of, **options)  # type: ignore[arg-type]
        is_others = Path(of) == tmp_path / name and (name == "outer" or not options["follow_symlinks"])
        return os.stat_result((*found[:4], found.st_uid + 1, *found[5:])) if is_others else found

    monkeypatch.setattr(os, "stat", status)
    with pytest.raises(UnsuitableFileError, match=f"another user owns .*{name}"):
        own_folder(path)


def test_links_to_a_folder_are_followed_to_its_end(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "first").symlink_to(tmp_path / "second")
    (tmp_path / "second").symlink_to("real/../real")
    own_folder(tmp_path / "first" / "own")
    assert (tmp_path / "real" / "own").is_dir()
    (tmp_path / "real").chmod(0o777)
    with pytest.raises(UnsuitableFileError, match=r"can write to .*real"):
        own_folder(tmp_path / "first" / "own")
    (tmp_path / "loop").symlink_to("loop")
    for name in ("loop", "loop/own"):
        with pytest.raises(UnsuitableFileError, match="symbolic links"):
            own_folder(tmp_path / name)


def test_a_folder_in_one_that_another_group_can_write_to_is_not_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own_folder(tmp_path / "outer" / "inner")
    (tmp_path / "outer").chmod(0o775)
    own_folder(tmp_path / "outer" / "inner")
    monkeypatch.setattr(os, "getegid", lambda: os.getgid() + 1)
    with pytest.raises(UnsuitableFileError, match="other users can write"):
        own_folder(tmp_path / "outer" / "inner")


def test_file_claim_excludes_others_and_names_its_holder_until_it_is_closed(tmp_path: Path) -> None:
    path = tmp_path / "claim"
    assert claim_holder(path) is None
    with FileClaim(path) as claim:
        with pytest.raises(ClaimedError, match="unknown"):
            FileClaim(path)
        claim.sign()
        assert claim_holder(path) == os.getpid()
        with pytest.raises(ClaimedError, match=f"^{os.getpid()}$"):
            FileClaim(path)
    assert claim_holder(path) is None
    FileClaim(path).close()
