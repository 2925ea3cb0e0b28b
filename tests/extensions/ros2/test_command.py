from __future__ import annotations

import ast
import os
import subprocess
from pathlib import Path

import pytest

from rwt.cli.errors import CommandError
from rwt.extensions.ros2.command import serve_options
from tests.processes import ended


def test_parameters_of_rosbridge_suite_become_settings() -> None:
    options, warnings = serve_options(
        {
            "port": "9091",
            "address": "''",
            "url_path": "/robot",
            "unregister_timeout": "3.0",
            "fragment_timeout": "60",
            "use_compression": "true",
            "call_services_in_new_thread": "True",
            "topics_glob": "",
        }
    )
    assert options == [
        "ws://0.0.0.0:9091/robot",
        *("--set", "unregister_timeout=3.0"),
        *("--set", "limits.fragment_seconds=60"),
        *("--set", "deflate=shared"),
    ]
    assert warnings == ["call_services_in_new_thread has no effect: calls never block the server"]


def test_a_certificate_means_tls() -> None:
    options, _ = serve_options({"certfile": "c.pem", "keyfile": "k.pem", "address": "10.0.0.1"})
    assert options == ["wss://10.0.0.1:9090", "--set", "tls.certfile=c.pem", "--set", "tls.keyfile=k.pem"]


def test_globs_become_a_role() -> None:
    options, _ = serve_options({"topics_glob": "['/odom', '/cam*']", "services_glob": "[]"})
    assert options[1::2] == ["--set"] * 8
    assert options[2::2] == [
        "auth.default_role=rosbridge",
        'roles.rosbridge.publish=["/odom", "/cam*"]',
        'roles.rosbridge.subscribe=["/odom", "/cam*"]',
        "roles.rosbridge.call=[]",
        "roles.rosbridge.provide=[]",
        'roles.rosbridge.goals=["*"]',
        'roles.rosbridge.get_param=["*"]',
        'roles.rosbridge.set_param=["*"]',
    ]


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"authenticate": "true"}, "parameter authenticate is not one of rosbridge_suite's: actions_glob, "),
        ({"topics_glob": "/odom"}, "topics_glob: expected a list such as"),
        ({"topics_glob": "[1]"}, "topics_glob: expected a list such as"),
        ({"topics_glob": "['a\"b']"}, "topics_glob: expected a list such as"),
    ],
)
def test_what_would_be_ignored_is_refused(parameters: dict[str, str], text: str) -> None:
    with pytest.raises(CommandError, match=text):
        serve_options(parameters)


def test_the_ament_package(tmp_path: Path) -> None:
    said = ended("ros2", "install", str(tmp_path / "my prefix"))
    assert said.stdout == f"export AMENT_PREFIX_PATH='{tmp_path}/my prefix':$AMENT_PREFIX_PATH\n"
    prefix = tmp_path / "my prefix"
    assert (prefix / "share/ament_index/resource_index/packages/rwt").exists()
    assert "<name>rwt</name>" in (prefix / "share/rwt/package.xml").read_text()
    launch = (prefix / "share/rwt/launch/rwt_launch.py").read_text()
    ast.parse(launch)
    assert str(prefix / "lib/rwt/serve") in launch
    serve = prefix / "lib/rwt/serve"
    assert os.access(serve, os.X_OK)
    refused = subprocess.run(
        [serve, "--ros-args", "-p", "a:=b"], capture_output=True, text=True, timeout=60, check=False
    )
    assert refused.returncode == 2
    assert "parameter a is not one of rosbridge_suite's" in refused.stderr


def test_a_file_of_parameters(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("/**:\n  ros__parameters:\n    nonsense: 1\n")
    assert "parameter nonsense" in ended("ros2", "serve", "--params-file", str(file)).stderr
    file.write_text("port: 1")
    assert "not a file of parameters" in ended("ros2", "serve", "--params-file", str(file)).stderr
