"""Meshes and textures over HTTP: browsers can fetch what a URDF names by ``package://``.

``package://my_arm/meshes/hand.dae`` is served as ``/packages/my_arm/meshes/hand.dae``. For
``UrdfClient`` of ros3djs, set the option ``path: "http://HOST:PORT/packages/"``.
"""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Iterable, Iterator, Mapping
from os.path import isfile
from pathlib import Path
from types import MappingProxyType
from typing import Final
from urllib.parse import unquote

import anyio
import anyio.to_thread

from rwt_interfaces.definitions.package_directories import package_name
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route

logger = logging.getLogger(__name__)

PATH: Final = "/packages/"

#: Extensions of served files, those of scenes. Packages contain other files, such as launch files with
#: passwords, which are not for every client.
CONTENT_TYPES: Final[Mapping[str, str]] = MappingProxyType(
    {
        ".dae": "model/vnd.collada+xml",
        ".stl": "model/stl",
        ".obj": "model/obj",
        ".mtl": "model/mtl",
        ".ply": "application/octet-stream",
        ".gltf": "model/gltf+json",
        ".glb": "model/gltf-binary",
        ".bin": "application/octet-stream",
        ".urdf": "application/xml",
        ".png": "image/png",
        ".jpg": "image/jpeg",
        ".jpeg": "image/jpeg",
        ".webp": "image/webp",
        ".bmp": "image/bmp",
        ".tga": "image/x-tga",
        ".tif": "image/tiff",
        ".tiff": "image/tiff",
    }
)
_CHUNK = 256 * 1024
_AS_DATA: Final = MappingProxyType({"Content-Security-Policy": "default-src 'none'; sandbox"})
"""Header of every file: browsers draw XML that is opened by itself, and would run the scripts in it."""


class MeshFilesError(ValueError):
    """A folder of packages cannot be served; the text names it and the reason."""


class MeshFiles:
    """HTTP server of the files of ROS packages.

    Args:
        folders: packages (folders with a `package.xml`), or folders that contain packages at any depth. A
            direct subfolder without `package.xml` is a package of its own name. If a name occurs twice, the
            first package counts.
        follow_links: True to serve files outside of `folders` that links in them lead to, as the workspaces
            of ``colcon build --symlink-install`` have.

    Attributes:
        http: extension for :func:`rwt.serve`.

    Raises:
        MeshFilesError: a path is not a folder, or is empty.
    """

    def __init__(self, folders: Iterable[Path], *, follow_links: bool = False) -> None:
        self._roots: dict[str, Path] = {}
        folders = tuple(folders)
        self._within = () if follow_links else tuple(folder.resolve() for folder in folders)
        if follow_links:
            logger.warning(
                "files outside of the folders of packages are served where links lead to them (package_links)"
            )
        for folder in folders:
            for root in _packages(folder):
                self._roots.setdefault(package_name(root), root)
        # The appearance of a robot needs no right to one topic.
        self.http: Final = HttpExtension((Route(f"{PATH}*", self._page, Audience.ADMITTED),))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the packages, sorted."""
        return tuple(sorted(self._roots))

    async def _page(self, request: HttpRequest, reader: Reader) -> HttpResponse:
        return await anyio.to_thread.run_sync(self._answer, request)

    def _answer(self, request: HttpRequest) -> HttpResponse:
        package, _, rest = unquote(request.path.removeprefix(PATH), errors="replace").partition("/")
        root = self._roots.get(package)
        if root is None:
            known = ", ".join(self.names)
            return _refusal(404, f"there is no package {package!r} here; there is {known}")
        path = _below(root, rest)
        if path is None or not isfile(path):  # raises no exceptions for names that are too long
            return _refusal(404, f"package {package} has no file {rest!r}")
        if self._within and not any(path.resolve().is_relative_to(each) for each in self._within):
            return _refusal(
                403, f"{rest!r} is a link out of the folders of packages; package_links allows that"
            )
        content_type = CONTENT_TYPES.get(path.suffix.lower())
        if content_type is None:
            kinds = " ".join(sorted(CONTENT_TYPES))
            return _refusal(403, f"{rest!r} is no mesh, texture or description; served are {kinds}")
        return _file(path, content_type, request.headers.get("if-none-match", ""))


def _packages(folder: Path) -> Iterator[Path]:
    try:
        found = list(_walk(folder.absolute(), set()))
        for root in sorted(_folders(folder.absolute())):
            if not any(root == other or root in other.parents or other in root.parents for other in found):
                found.append(root)
    except OSError as error:
        raise MeshFilesError(f"{error.filename or folder}: cannot be read: {error.strerror}") from None
    if not found:
        raise MeshFilesError(f"{folder}: no packages; expected PACKAGE/meshes/… in it, or a package.xml")
    yield from found


def _walk(folder: Path, seen: set[Path]) -> Iterator[Path]:
    """Iterate over the folders with a `package.xml`, without descending into them."""
    if folder.resolve() in seen:
        return  # a link to a visited folder
    seen.add(folder.resolve())
    if (folder / "package.xml").is_file():
        yield folder
        return
    for entry in sorted(_folders(folder)):
        yield from _walk(entry, seen)


def _folders(folder: Path) -> Iterator[Path]:
    return (entry for entry in folder.iterdir() if entry.is_dir() and not entry.name.startswith("."))


def _below(root: Path, rest: str) -> Path | None:
    """Return a file of a package; None for hidden files and paths that lead out of the package."""
    parts = rest.split("/")
    # On Windows a backslash and the colon of a drive leave the package.
    if any(not part or part.startswith(".") or set(part) & set("\\:\0") for part in parts):
        return None
    return root.joinpath(*parts)


def _file(path: Path, content_type: str, known_tag: str) -> HttpResponse:
    try:
        path.open("rb").close()
        state = path.stat()
    except OSError as error:
        return _refusal(403, f"{path.name} cannot be read: {error.strerror}")
    tag = f'"{state.st_mtime_ns:x}-{state.st_size:x}"'
    # With "no-cache", browsers store it and revalidate it on each use (RFC 9111 section 5.2.2.4).
    headers = {**_AS_DATA, "ETag": tag, "Cache-Control": "no-cache"}
    if tag in known_tag:
        return HttpResponse(b"", 304, content_type, headers)
    return HttpResponse(file_chunks(path), 200, content_type, headers)


async def file_chunks(path: Path) -> AsyncIterator[bytes]:
    """Yield the content of a file, read in threads."""
    async with await anyio.open_file(path, "rb") as file:
        while chunk := await file.read(_CHUNK):
            yield chunk


def _refusal(status: int, text: str) -> HttpResponse:
    return HttpResponse(f"{text}\n".encode(), status)
