"""Deprecated names of modules that have moved; they work until version 0.3."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import MappingProxyType, ModuleType
from typing import Final

MOVED: Final[Mapping[str, str]] = MappingProxyType(
    {
        "rwt.extensions.depth_cloud.point_cloud": "rwt_interfaces.point_clouds.records",
        "rwt.gateways.foxglove": "rwt.extensions.foxglove",
        "rwt.gateways.http": "rwt.extensions.http",
        "rwt.gateways.mcp": "rwt.extensions.mcp",
        "rwt.gateways.rosbridge": "rwt.rosbridge",
        "rwt.hub": "rwt.extensions.hub",
        "rwt.media.webrtc": "rwt_webrtc.media",
        "rwt.nodes.demo": "rwt.extensions.demo",
        "rwt.nodes.depth_cloud.point_cloud": "rwt_interfaces.point_clouds.records",
        "rwt.nodes.depth_cloud": "rwt.extensions.depth_cloud",
        "rwt.nodes.interactive_markers": "rwt.extensions.markers",
        "rwt.nodes.mesh_files": "rwt.extensions.meshes.mesh_files",
        "rwt.nodes.playback": "rwt.extensions.recording.playback",
        "rwt.nodes.recording": "rwt.extensions.recording",
        "rwt.nodes.rosapi": "rwt.rosapi",
        "rwt.nodes.tf": "rwt.extensions.tf_stream",
        "rwt.nodes.video": "rwt.extensions.video",
        "rwt.testing": "rwt.extensions.testing",
        "rwt.web": "rwt.extensions.dashboard",
    }
)
"""New names of packages, by their names in version 0.1."""


NAMES: Final[Mapping[str, str]] = MappingProxyType({"PlaybackServer": "rwt.extensions.recording.playback"})
"""New modules of names that `rwt` itself had in version 0.1."""


def with_moved_names(get: Callable[[str], object]) -> Callable[[str], object]:
    """Return the `__getattr__` of `rwt`, which also finds names that have moved."""

    def get_moved(name: str) -> object:
        if name not in NAMES:
            return get(name)
        warnings.warn(f"rwt.{name} has moved to {NAMES[name]}", DeprecationWarning, stacklevel=2)
        return getattr(import_module(NAMES[name]), name)

    return get_moved


class _Alias(Loader):
    """Loader whose module is another one, under a second name."""

    def __init__(self, target: str) -> None:
        self._target = target
        self._spec: ModuleSpec | None = None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Import the module under its new name."""
        module = import_module(self._target)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Restore the spec of the module, which has been executed already."""
        # The import system has given the module the spec of the alias.
        module.__spec__ = self._spec


class _MovedModules(MetaPathFinder):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of an alias; None for other names."""
        if not fullname.startswith("rwt."):
            return None
        old = next((old for old in MOVED if fullname == old or fullname.startswith(f"{old}.")), None)
        if old is None:
            return None
        new = MOVED[old] + fullname.removeprefix(old)
        warnings.warn(f"{fullname} has moved to {new}", DeprecationWarning, stacklevel=2)
        return ModuleSpec(fullname, _Alias(new), is_package=True)


def install() -> None:
    """Let imports of the old names find the modules; called once, by `rwt` itself."""
    # Before the finder of files, which would load modules of an aliased package a second time.
    sys.meta_path.insert(0, _MovedModules())
