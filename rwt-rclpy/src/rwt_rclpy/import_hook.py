"""Import hook for `import rclpy` and `from std_msgs.msg import String`, active after :func:`install`.

An installed ROS takes precedence: then the hook is not installed.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Iterator, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from rwt_interfaces.errors import UnknownType
from rwt_interfaces.names import KINDS
from rwt_rclpy.messages.classes import module_of
from rwt_rclpy.messages.loaded import classes
from rwt_rclpy.modules import ABSENT, ABSENT_IN_RCLPY, MODULES


class MixedInstallation(ImportError):
    """ROS is installed in part, which would be mixed with this package."""


class InterfaceModule(ModuleType):
    """Module such as `std_msgs.msg`, whose classes are created on first use."""

    def __init__(self, name: str, package: str, kind: str) -> None:
        super().__init__(name, f"The {kind} interfaces of {package}.")
        self.__path__: list[str] = []
        self._package = package
        self._kind = kind

    @property
    def __all__(self) -> list[str]:
        return _names(self._package, self._kind)

    def __dir__(self) -> list[str]:
        return _names(self._package, self._kind)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        try:
            found = classes().by_type_name(f"{self._package}/{self._kind}/{name}")
        except UnknownType as error:
            if name in self.__all__:
                # It exists, but needs a missing module. Python does not show the cause of an AttributeError.
                raise ImportError(f"{self.__name__}.{name}: {error}", name=self.__name__) from None
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}: {error}") from None
        setattr(self, name, found)
        return found


#: Further names in the module of an interface.
_PARTS = {
    "msg": (),
    "srv": ("Request", "Response", "Event"),
    "action": (
        "Goal",
        "Result",
        "Feedback",
        "FeedbackMessage",
        "SendGoal",
        "SendGoal_Request",
        "SendGoal_Response",
        "GetResult",
        "GetResult_Request",
        "GetResult_Response",
    ),
}


def _names(package: str, kind: str) -> list[str]:
    start = f"{package}/"
    names = classes().registry.names(kind) if kind in KINDS else ()
    return [each.removeprefix(start) for each in names if each.startswith(start)]


def packages() -> set[str]:
    """Return the packages of interfaces that can be imported."""
    names = classes().registry.names
    return {full.partition("/")[0] for kind in KINDS for full in names(kind)}


class _Alias(Loader):
    """Loader of a module under another name."""

    def __init__(self, target: str) -> None:
        self._target = target
        self._name = ""
        self._spec: ModuleSpec | None = None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = importlib.import_module(self._target)
        self._name = spec.name
        self._spec = module.__spec__
        if not hasattr(module, "__path__"):
            # The name may be that of a package, although the module is not a package.
            module.__path__ = []
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Register names below that denote the same module.

        Otherwise, importing one would replace a function of the same name by the module, such as
        `rosidl_runtime_py.get_interfaces`.
        """
        module.__spec__ = self._spec
        for name, target in MODULES.items():
            parent, _, last = name.rpartition(".")
            if parent == self._name and target == self._target:
                sys.modules.setdefault(name, module)
                if not hasattr(module, last):
                    setattr(module, last, module)


class _Interfaces(Loader):
    """Loader of `pkg`, `pkg.msg` and `pkg.msg._name`."""

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        package, *rest = spec.name.split(".")
        if not rest:
            module = ModuleType(package, f"The interfaces of {package}.")
            module.__path__ = []
            return module
        if len(rest) == 1:
            return InterfaceModule(spec.name, package, rest[0])
        module = ModuleType(spec.name)
        for name in _names(package, rest[0]):
            if module_of(name) == rest[1]:
                for part in (name, *(f"{name}_{part}" for part in _PARTS[rest[0]])):
                    setattr(module, part, classes().by_type_name(f"{package}/{rest[0]}/{part}"))
        return module

    def exec_module(self, module: ModuleType) -> None:
        """No-op: the classes are made on first use."""


class RosFinder(MetaPathFinder):
    """Finder of this package's modules under the names of ROS.

    Attributes:
        packages: packages of interfaces; stored, because finding them imports modules.
    """

    def __init__(self) -> None:
        self.packages: frozenset[str] = frozenset()

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the module of a ROS name; None for other names."""
        top, _, rest = fullname.partition(".")
        if fullname in MODULES:
            if not rest and top != "rclpy" and _installed(top) is not None:
                return None  # A separately installed companion takes precedence.
            return self._spec(fullname, _Alias(MODULES[fullname]))
        if top == "rclpy":
            reason = next(
                (why for name, why in ABSENT_IN_RCLPY.items() if f"{fullname}.".startswith(f"{name}.")),
                "use what docs/how-to/rclpy.md lists",
            )
            raise ModuleNotFoundError(f"{fullname} is not available without ROS: {reason}", name=fullname)
        if fullname in ABSENT and (rest or _installed(top) is None):
            raise ModuleNotFoundError(
                f"{fullname} is not available without ROS: {ABSENT[fullname]}", name=fullname
            )
        if top not in self.packages:
            return None
        installed = _installed(top)
        if installed is not None:
            if not _has_interfaces(installed):
                return None  # A package of programs with the same name as one of interfaces.
            raise MixedInstallation(
                f"the package {top} is installed at {installed.origin}, and rclpy is not: install or source"
                " all of ROS, or take this folder off PYTHONPATH",
                name=fullname,
            )
        parts = rest.split(".") if rest else []
        if len(parts) > 2 or (parts and not _names(top, parts[0])):
            return None
        if len(parts) == 2 and not any(module_of(name) == parts[1] for name in _names(top, parts[0])):
            return None
        return self._spec(fullname, _Interfaces())

    @staticmethod
    def _spec(name: str, loader: Loader) -> ModuleSpec:
        return ModuleSpec(name, loader, origin="rwt_rclpy", is_package=True)


def _installed(name: str) -> ModuleSpec | None:
    """Return the regular package of a name on the path; a folder without ``__init__.py`` does not count."""
    try:
        spec = PathFinder.find_spec(name)
    except (ImportError, ValueError):
        return None
    return None if spec is None or spec.origin is None else spec


def _has_interfaces(spec: ModuleSpec) -> bool:
    """True if an installed package has classes of messages, services or actions."""
    folders = spec.submodule_search_locations or ()
    return any((Path(folder) / kind).is_dir() for folder in folders for kind in KINDS)


_finder = RosFinder()


def ros_is_installed() -> str:
    """Return the place of an installed rclpy of ROS; empty if there is none."""
    spec = _installed("rclpy")
    return "" if spec is None or spec.origin is None else spec.origin


def install() -> None:
    """Let programs import this package's modules under the names of ROS."""
    _finder.packages = frozenset(packages())
    if _finder not in sys.meta_path:
        sys.meta_path.insert(0, _finder)


def uninstall() -> None:
    """Undo :func:`install`, and remove modules that were imported under ROS's names."""
    if _finder in sys.meta_path:
        sys.meta_path.remove(_finder)
    for name in tuple(_ours()):
        del sys.modules[name]


def _ours() -> Iterator[str]:
    known = packages()
    for name, module in sys.modules.items():
        top = name.partition(".")[0]
        if name in MODULES or (top in known and isinstance(getattr(module, "__loader__", None), _Interfaces)):
            yield name
