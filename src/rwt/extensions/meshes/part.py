"""Declaration of the server of meshes."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from rwt.access.settings import SettingsError, Table
from rwt.declarations import NodeContext, NodePart, Option
from rwt_transports.http.routes import HttpExtension


class MeshSettings(Table):
    """Settings of the server of meshes, at the top level."""

    packages: tuple[Path, ...] = Field(
        (), description="folders of ROS packages whose meshes are served under `/packages/`"
    )
    package_links: bool = Field(
        False,
        description="serve files outside of the folders of `packages` that links in them lead to, after"
        " `colcon build --symlink-install`; anyone who can write there can publish any mesh or image",
    )


def _make(context: NodeContext, settings: MeshSettings) -> HttpExtension:
    from rwt.extensions.meshes.mesh_files import MeshFiles, MeshFilesError

    try:
        return MeshFiles(settings.packages, follow_links=settings.package_links).http
    except MeshFilesError as error:
        raise SettingsError(f"`packages`: {error}") from error


PART = NodePart(
    summary="meshes of ROS packages over HTTP, for viewers of robot descriptions",
    settings=MeshSettings,
    at_top_level=True,
    is_on=lambda settings: bool(settings.packages),
    make=_make,
    on_every_worker=True,
    options=(
        Option(
            "--packages",
            "packages",
            {
                "action": "append",
                "type": Path,
                "metavar": "DIR",
                "help": "folder of ROS packages, whose meshes are served under /packages/; may be given"
                " several times",
            },
        ),
    ),
)
