"""A package of messages that nobody else has, and a program of roscpp that relays messages of all types.

Both are generated and compiled with Debian's genmsg, gencpp, genpy and g++.
"""

from __future__ import annotations

import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

#: Messages of the package, by name.
UNSEEN: Final = {
    "Part": "string text\nfloat64[2] pair\nint64 large\n",
    "Assembly": """\
uint8 READY = 3
string WORD = not "quoted" # text
Header header
Part[] parts
Part[2] two
duration wait
time when
uint8[] raw
bool[3] flags
geometry_msgs/PoseStamped[] poses
""",
}
PACKAGE: Final = "unseen_msgs"
UNSEEN_TYPES: Final = tuple(f"{PACKAGE}/{name}" for name in UNSEEN)

_INCLUDE: Final = Path("/usr/include")

_RELAY: Final = r"""
#include <ros/ros.h>
#include <list>
static std::list<ros::Publisher> publishers;
static std::list<ros::Subscriber> subscribers;
template <typename T> void relay(ros::NodeHandle& node, const std::string& name) {
  publishers.push_back(node.advertise<T>("/cpp/" + name, 1000, true));
  ros::Publisher* publisher = &publishers.back();
  boost::function<void(const boost::shared_ptr<T const>&)> received =
      [publisher](const boost::shared_ptr<T const>& message) {
        T copy = *message;
        publisher->publish(copy);
      };
  subscribers.push_back(node.subscribe<T>("/back/" + name, 1000, received));
}
"""

_MAIN: Final = r"""
int main(int argc, char** argv) {
  ros::init(argc, argv, "relay");
  ros::NodeHandle node;
  %s
  ros::spin();
}
"""


@dataclass(frozen=True, slots=True)
class Relay:
    """Compiled program, which publishes on `/cpp/TYPE` what it receives on `/back/TYPE`.

    Attributes:
        program: path of the program.
        types: types of its topics.
        python_path: folder of the generated package for rospy.
    """

    program: str
    types: tuple[str, ...]
    python_path: str


def generate_package(folder: Path) -> None:
    """Generate the package for rospy and roscpp, in a folder that both use as their search path."""
    source, python = folder / PACKAGE / "source", folder / PACKAGE / "msg"
    source.mkdir(parents=True)
    search = []
    for package in ("std_msgs", "geometry_msgs"):
        search += ["-I", f"{package}:/usr/share/{package}/msg"]
    search += ["-I", f"{PACKAGE}:{source}"]
    for name, text in UNSEEN.items():
        (source / f"{name}.msg").write_text(text, encoding="utf-8")
    for name in UNSEEN:
        message = str(source / f"{name}.msg")
        _run("/usr/lib/gencpp/gen_cpp.py", message, "-p", PACKAGE, "-o", str(folder / PACKAGE), *search,
             "-e", "/usr/share/gencpp")  # fmt: skip
        _run("/usr/lib/genpy/genmsg_py.py", message, "-p", PACKAGE, "-o", str(python), *search)
    _run("/usr/lib/genpy/genmsg_py.py", "--initpy", "-p", PACKAGE, "-o", str(python))
    (folder / PACKAGE / "__init__.py").touch()


def build_relay(folder: Path, types: tuple[str, ...]) -> Relay:
    """Compile the program for the types that roscpp has, in two halves at once."""
    generate_package(folder)
    known = tuple(
        name for name in types if any((each / f"{name}.h").is_file() for each in (_INCLUDE, folder))
    )
    halves = (known[::2], known[1::2])
    with ThreadPoolExecutor() as pool:
        tuple(pool.map(_compile, (folder, folder), range(2), halves))
    main = "\n".join(f"void relay_{number}(ros::NodeHandle&);" for number in range(2))
    main += _MAIN % "\n  ".join(f"relay_{number}(node);" for number in range(2))
    (folder / "main.cpp").write_text(f"#include <ros/ros.h>\n{main}", encoding="utf-8")
    libraries = ("-lroscpp", "-lrosconsole", "-lroscpp_serialization", "-lrostime", "-lboost_system")
    objects = (str(folder / f"half_{number}.o") for number in range(2))
    program = str(folder / "relay")
    _run("g++", "-O0", "-o", program, str(folder / "main.cpp"), *objects, *libraries, python=False)
    return Relay(program, known, str(folder))


def _compile(folder: Path, number: int, types: tuple[str, ...]) -> None:
    includes = "\n".join(f"#include <{name}.h>" for name in types)
    calls = "\n".join(f'  relay<{name.replace("/", "::")}>(node, "{name}");' for name in types)
    source = folder / f"half_{number}.cpp"
    text = f"{_RELAY}\n{includes}\nvoid relay_{number}(ros::NodeHandle& node) {{\n{calls}\n}}\n"
    source.write_text(text, encoding="utf-8")
    _run(
        "g++", "-O0", "-c", "-I", str(folder), "-o", str(source.with_suffix(".o")), str(source), python=False
    )


def _run(*command: str, python: bool = True) -> None:
    words = ("/usr/bin/python3", *command) if python else command
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (done.stdout + done.stderr)[:3000]
