"""Interface packages on disk."""

from __future__ import annotations

import errno
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rwt_interfaces.definitions.parser import LONGEST_TEXT, too_long
from rwt_interfaces.errors import DefinitionError
from rwt_interfaces.names import KINDS, Kind, is_word

_MANIFEST_BYTES = 1024 * 1024

_NAME_ELEMENT = re.compile(r"<name>\s*([^<\s]+)\s*</name>")


@dataclass(frozen=True, slots=True)
class InterfaceFile:
    """A ``.msg``, ``.srv`` or ``.action`` file."""

    path: Path
    package: str
    kind: Kind
    name: str

    def read(self) -> str:
        """Return the text; raises DefinitionError if it is unreadable, not UTF-8, or too long."""
        try:
            # At most four bytes per character.
            return _read_file(self.path, 4 * LONGEST_TEXT).decode("utf-8-sig")
        except UnicodeDecodeError:
            raise DefinitionError(f"{self.path}: not UTF-8 text") from None
        except OSError as error:
            if error.errno == errno.EFBIG:
                raise DefinitionError(too_long(str(self.path))) from None
            raise DefinitionError(f"{self.path}: cannot be read: {error.strerror}") from None


def interface_files(folder: Path) -> list[InterfaceFile]:
    """Return the files of a package, or of every package below a folder, sorted by path.

    A package has a folder ``msg``, ``srv`` or ``action`` with such files, and the name in its
    ``package.xml``, or else its folder's name. Hidden folders are skipped.

    Raises:
        DefinitionError: the folder does not exist or has no interfaces, or a name is invalid in ROS.
    """
    if not folder.is_dir():
        raise DefinitionError(f"{folder}: no such folder")
    try:
        found = sorted(_files(folder.absolute(), set()), key=lambda file: file.path)
    except OSError as error:
        raise DefinitionError(f"{error.filename or folder}: cannot be read: {error.strerror}") from None
    if not found:
        raise DefinitionError(
            f"{folder}: no interface files; expected PACKAGE/msg/X.msg, and so on for srv and action"
        )
    return found


def _files(folder: Path, seen: set[Path]) -> Iterator[InterfaceFile]:
    if folder.resolve() in seen:
        return  # a link to a visited folder
    seen.add(folder.resolve())
    for kind in KINDS:
        for path in sorted((folder / kind).glob(f"*.{kind}")):
            package = package_name(folder)
            for word in (package, path.stem):
                if not is_word(word):
                    raise DefinitionError(
                        f'{path}: "{word}" cannot be a name: letters, digits and _, beginning with a letter'
                    )
            yield InterfaceFile(path, package, kind, path.stem)
    for entry in sorted(folder.iterdir()):
        if entry.is_dir() and not entry.name.startswith("."):
            yield from _files(entry, seen)


def package_name(folder: Path) -> str:
    """Return the package's name in its ``package.xml``, or else the folder's name.

    Searches for that element only, to avoid the entities that an XML parser would expand.
    """
    manifest = folder / "package.xml"
    if manifest.is_file():
        found = _NAME_ELEMENT.search(_read_file(manifest, _MANIFEST_BYTES).decode("utf-8", "replace"))
        if found is not None:
            return found[1]
    return folder.name


def _read_file(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file; pipes and devices would block, or never end.

    Raises:
        OSError: it is not a regular file, is too large (EFBIG), or cannot be read.
    """
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with open(descriptor, "rb") as file:
        # Checked on the descriptor, since the path may lead to another file by now.
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "not a regular file", str(path))
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise OSError(errno.EFBIG, f"larger than {most_bytes} bytes", str(path))
    return content
