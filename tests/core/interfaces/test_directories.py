"""Interface packages on disk."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwt_interfaces.errors import DefinitionError
from rwt_interfaces.names import KINDS
from rwt_interfaces.registry import Registry

FILES = {
    "my_msgs/package.xml": "<package><name> my_robot_msgs </name></package>",
    "my_msgs/msg/Status.msg": "Header header\r\nPart[] parts\r\n",
    "my_msgs/msg/Part.msg": "\ufeffstring name\n",
    "my_msgs/srv/Reset.srv": "---\nbool ok\n",
    "my_msgs/README.md": "not an interface",
    "nested/deeper/other_msgs/action/Drive.action": "my_robot_msgs/Part to\n---\n---\nfloat32 left\n",
    "nested/.hidden/secret_msgs/msg/No.msg": "int8 a\n",
}


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, "utf-8", newline="")
    return tmp_path


def user_names(registry: Registry) -> set[str]:
    known = Registry(registry.distro)
    return {name for kind in KINDS for name in set(registry.names(kind)) - set(known.names(kind))}


def test_reads_every_package_below_a_folder(workspace: Path) -> None:
    registry = Registry()
    registry.add_directory(workspace)
    registry.verify()
    assert user_names(registry) == {
        "my_robot_msgs/Status",
        "my_robot_msgs/Part",
        "my_robot_msgs/Reset",
        "other_msgs/Drive",
    }
    assert registry.message("my_robot_msgs/msg/Status").definition.fields[1].type.name == "my_robot_msgs/Part"
    assert registry.action("other_msgs/Drive").goal.definition.fields[0].name == "to"


def test_reads_one_package(workspace: Path) -> None:
    registry = Registry()
    registry.add_directory(str(workspace / "nested" / "deeper" / "other_msgs"))
    assert user_names(registry) == {"other_msgs/Drive"}


def test_follows_links_but_not_in_circles(workspace: Path) -> None:
    (workspace / "my_msgs" / "again").symlink_to(workspace)
    (workspace / "only_links").mkdir()
    (workspace / "only_links" / "linked_msgs").symlink_to(workspace / "nested" / "deeper" / "other_msgs")
    registry = Registry()
    registry.add_directory(workspace / "my_msgs")
    assert "my_robot_msgs/Status" in user_names(registry)
    linked = Registry()
    linked.add_directory(workspace / "only_links")
    assert user_names(linked) == {"linked_msgs/Drive"}


def test_an_error_names_file_and_line_and_adds_nothing(workspace: Path) -> None:
    bad = workspace / "my_msgs" / "msg" / "Zz.msg"
    bad.write_text("int8 a\nint8\n")
    registry = Registry()
    with pytest.raises(DefinitionError) as caught:
        registry.add_directory(workspace)
    assert str(caught.value) == f'{bad}:2: expected a name after "int8"'
    assert user_names(registry) == set()


def test_the_same_name_twice_must_say_the_same(workspace: Path) -> None:
    copy = workspace / "install" / "my_robot_msgs" / "msg"
    copy.mkdir(parents=True)
    (copy / "Part.msg").write_text("# a copy\nstring name\n")
    registry = Registry()
    registry.add_directory(workspace)
    (copy / "Part.msg").write_text("string title\n")
    with pytest.raises(DefinitionError, match=r"my_robot_msgs/Part is defined differently in .*Part\.msg"):
        registry.add_directory(workspace)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a_msgs/msg/My-Type.msg", b"", '"My-Type" cannot be a name'),
        ("a-msgs/msg/Type.msg", b"", '"a-msgs" cannot be a name'),
        ("a_msgs/msg/Type.msg", b"string \xff", "not UTF-8 text"),
        ("a_msgs/msg/Type.txt", b"", "no interface files; expected PACKAGE/msg/X.msg"),
        ("a_msgs/Type.msg", b"", "no interface files"),
    ],
)
def test_what_is_no_package_is_refused_with_the_reason(
    tmp_path: Path, name: str, content: bytes, reason: str
) -> None:
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DefinitionError) as caught:
        Registry().add_directory(tmp_path)
    assert reason in str(caught.value)


def test_a_folder_that_does_not_exist(tmp_path: Path) -> None:
    with pytest.raises(DefinitionError, match="no such folder"):
        Registry().add_directory(tmp_path / "none")
    file = tmp_path / "file.msg"
    file.write_text("int8 a")
    with pytest.raises(DefinitionError, match="no such folder"):
        Registry().add_directory(file)


def test_a_file_that_cannot_be_opened(tmp_path: Path) -> None:
    # A folder named like a file fails for every user, root included.
    (tmp_path / "a_msgs" / "msg" / "Odd.msg").mkdir(parents=True)
    with pytest.raises(DefinitionError, match=r"Odd\.msg: cannot be read: "):
        Registry().add_directory(tmp_path)
