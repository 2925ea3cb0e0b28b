"""Broken set-ups: what `rwt doctor` and `rwt serve --check` print, also as the table of a page."""

from __future__ import annotations

import datetime
import os
import re
import socket
import ssl
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID

from tests.processes import ROOT, ended, free_port, running

PAGE = ROOT / "docs" / "how-to" / "on-call.md"
NGINX_PAGE = b"<html><head><title>400 Bad Request</title></head><body>nginx</body></html>"
Run = Callable[[Path, ExitStack], tuple[int, str]]
TOKEN = "a-token-of-thirty-two-characters"


def certify(folder: Path, days: float) -> tuple[Path, Path]:
    """Make a certificate for localhost that expires in some days; returns it and its key."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "localhost")])
    now = datetime.datetime.now(datetime.UTC)
    end = now + datetime.timedelta(days=days)
    begin = min(now, end) - datetime.timedelta(days=1)
    builder = x509.CertificateBuilder(name, name, key.public_key(), 7, begin, end)
    names = x509.SubjectAlternativeName([x509.DNSName("localhost")])
    certificate = builder.add_extension(names, critical=False).sign(key, hashes.SHA256())
    cert, private = folder / "cert.pem", folder / "key.pem"
    cert.write_bytes(certificate.public_bytes(Encoding.PEM))
    private.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    return cert, private


@contextmanager
def answering(answer: bytes, tls: ssl.SSLContext | None = None) -> Iterator[int]:
    """A server that reads a request, answers and closes; yields its port."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            while True:
                try:
                    connection = listener.accept()[0]
                except OSError:
                    return
                with connection:
                    try:
                        wire = connection if tls is None else tls.wrap_socket(connection, server_side=True)
                        wire.recv(65536)
                        wire.sendall(answer)
                    except OSError:
                        continue

        thread = threading.Thread(target=serve)
        thread.start()
        yield listener.getsockname()[1]
        listener.shutdown(socket.SHUT_RDWR)
    thread.join()


def http(status: str, body: bytes = b"", kind: str = "text/html") -> bytes:
    return f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body


@dataclass(frozen=True)
class Broken:
    """A broken set-up.

    Attributes:
        cause: what is wrong, as the page says it.
        run: makes it, and returns exit status and output.
        status: expected exit status.
        prints: line of the output that names the cause.
        mends: part of the advice; empty for settings, whose error says it.
    """

    cause: str
    run: Run
    status: int
    prints: str
    mends: str = ""


def doctor(*arguments: str) -> tuple[int, str]:
    done = ended("doctor", "--timeout", "5", *arguments)
    return done.returncode, done.stdout + done.stderr


def by_doctor(url: str, answer: bytes, days: float | None = None) -> Run:
    def run(folder: Path, stack: ExitStack) -> tuple[int, str]:
        tls, options = None, []
        if days is not None:
            tls = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
            tls.load_cert_chain(*certify(folder, days))
            options = ["--cafile", str(folder / "cert.pem")] if days < 0 else []
        port = stack.enter_context(answering(answer, tls))
        return doctor(f"{url}://localhost:{port}", *options)

    return run


def to(url: str) -> Run:
    return lambda folder, stack: doctor(url.replace("PORT", str(free_port())).replace("DIR", str(folder)))


def with_server(settings: str, *options: str) -> Run:
    def run(folder: Path, stack: ExitStack) -> tuple[int, str]:
        (folder / "rwt.toml").write_text(settings)
        command = ("serve", "ws://127.0.0.1:0", "--config", str(folder / "rwt.toml"))
        return doctor(stack.enter_context(running(*command))[1], *options)

    return run


def check(settings: str, days: float | None = None) -> Run:
    def run(folder: Path, stack: ExitStack) -> tuple[int, str]:
        if days is not None:
            certify(folder, days)
        (folder / "rwt.toml").write_text(settings.replace("DIR", str(folder)))
        done = ended("serve", "--check", "--config", str(folder / "rwt.toml"))
        return done.returncode, done.stdout + done.stderr

    return run


_TLS = 'listen = ["wss://127.0.0.1:0"]\n[tls]\ncertfile = "DIR/cert.pem"\nkeyfile = "DIR/key.pem"\n'
_RULE = '[gate.rules.a]\ntopics = ["/a"]\n'
_TOKENS = f'[auth.tokens.me]\ntoken = "{TOKEN}"\nrole = "admin"\n'

SETUPS = [
    Broken("no server runs", to("ws://127.0.0.1:PORT"), 3, "the connection was refused", "start the server"),
    Broken("the host name is wrong", to("ws://robot.invalid:9090"), 3, "the host is not known",
           "check the host name"),
    Broken("the unix socket is not there", to("unix://DIR/robot.sock"), 3, "there is no such file",
           "start the server"),
    Broken("a proxy passes no `Upgrade` on (400)", by_doctor("ws", http("400 Bad Request", NGINX_PAGE)), 3,
           "answers 400 Bad Request", "proxy_set_header Upgrade"),
    Broken("a proxy answers with its own page", by_doctor("ws", http("200 OK", NGINX_PAGE)), 3,
           "answers 200 OK", "proxy_set_header Upgrade"),
    Broken("the proxy finds no server (502)", by_doctor("ws", http("502 Bad Gateway", NGINX_PAGE)), 3,
           "answers 502 Bad Gateway", "compare port and path"),
    Broken("`ws://` to a port with TLS", by_doctor("ws", b"", 60), 3, "hung up", "use wss://"),
    Broken("`wss://` to a port without TLS", by_doctor("wss", http("400 Bad Request")), 3,
           "does not speak TLS", "use ws://"),
    Broken("the certificate has expired", by_doctor("wss", b"", -3), 3, "certificate has expired",
           "renew the certificate"),
    Broken("the certificate's authority is not known", by_doctor("wss", b"", 60), 3,
           "self-signed certificate", "--cafile"),
    Broken("another kind of server listens there", by_doctor("ws", b"SSH-2.0-OpenSSH_9.6\r\n"), 3,
           "WebSocket", "another kind of server"),
    Broken("the token is missing", with_server(_TOKENS), 3, "answers 401", "requires a token"),
    Broken("the token is wrong", with_server(_TOKENS, "--token", "x" * 20), 3, "answers 401",
           "the token is invalid"),
    Broken("a page of this origin may not connect",
           with_server("", "--origin", "https://ui.example.com"), 3, "answers 403", "with its port"),
    Broken("the role may do too little", with_server('[auth]\ndefault_role = "viewer"\n'), 0, "permissions:"),
    Broken("no gate rule guards the topic that drives the robot", with_server("demo = true\n"), 0,
           "no gate rule guards `/cmd_vel`", "add a rule"),
    Broken("a setting is misspelt", check("lisen = 5\n"), 2, "did you mean `listen`?"),
    Broken("the file is not TOML", check("listen = [\n"), 2, "not TOML"),
    Broken("a token's role is not defined", check(f'[auth.tokens.me]\ntoken = "{TOKEN}"\nrole = "pilot"\n'),
           2, "there is no role 'pilot'"),
    Broken("the file of a token is missing",
           check('[auth.tokens.me]\ntoken_file = "DIR/none"\nrole = "admin"\n'), 2, "cannot be read"),
    Broken("two tokens are the same", check(_TOKENS + _TOKENS.replace(".me", ".you")), 2, "the same token"),
    Broken("a certificate that has expired", check(_TLS, -3), 2, "has expired"),
    Broken("a certificate that expires soon", check(_TLS, 9), 0, "expires in 9 days"),
    Broken("a certificate without its key", check(_TLS.replace("key.pem", "cert.pem"), 60), 2,
           "the key that belongs to it"),
    Broken("the folder of the audit is missing", check('[gate.audit]\nfile = "DIR/none/audit.jsonl"\n'), 2,
           "there is no such folder"),
    Broken("the folder of recordings is a file", check('[recorder]\nfolder = "DIR/rwt.toml"\n'), 2,
           "expected a folder"),
    Broken("a rule limits a field that its type does not have",
           check(f"{_RULE}type = \"std_msgs/String\"\nfields.speed = {{ max = 1 }}\n"), 2, "speed"),
    Broken("a rule is about topics of an unknown type",
           check(f'{_RULE}type = "my_msgs/Speed"\n'), 2, "gate.rules.a.type"),
]  # fmt: skip


@cache
def outcome(broken: Broken) -> tuple[int, str]:
    """Return exit status and output; the ports and names that each run chooses are replaced."""
    with ExitStack() as stack, TemporaryDirectory() as folder:
        status, output = broken.run(Path(folder), stack)
    output = re.sub(r"(localhost|127\.0\.0\.1):\d+", r"\1:PORT", output.replace(folder, "/etc/robot"))
    return status, re.sub(r"rwt_doctor_[0-9a-f]{8}", "rwt_doctor_NUMBER", output)


@pytest.mark.parametrize("broken", SETUPS, ids=[each.cause for each in SETUPS])
def test_a_broken_set_up_is_named_with_what_mends_it(broken: Broken) -> None:
    status, output = outcome(broken)
    assert status == broken.status, output
    cause, advice = cause_and_advice(broken, output)
    assert broken.prints in cause and broken.mends in advice, output
    assert "Traceback" not in output and "<html" not in output


def cause_and_advice(broken: Broken, output: str) -> tuple[str, str]:
    """Return the last line that names the cause, and the advice that follows it; empty if there is none."""
    lines = output.splitlines()
    at = max((number for number, line in enumerate(lines) if broken.prints in line), default=0)
    following = lines[at + 1].strip() if at + 1 < len(lines) else ""
    return lines[at], following.removeprefix("-> ") if following.startswith("-> ") else ""


def table() -> str:
    """Return the table of the page."""
    rows = ["| broken | command | exit | prints | advice |", "|---|---|---|---|---|"]
    for each in SETUPS:
        command = "`rwt serve --check`" if each.run.__qualname__.startswith("check.") else "`rwt doctor`"
        status, output = outcome(each)
        cause, advice = cause_and_advice(each, output)
        cells = (each.cause, command, str(status), f"`` {' '.join(cause.split())} ``", advice)
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have other texts for their errors")
def test_the_page_has_the_table() -> None:
    """With WRITE_DOCS, the table is written instead."""
    text = PAGE.read_text(encoding="utf-8")
    found = re.search(r"(?<=<!-- broken set-ups -->\n).*?(?=\n<!-- end -->)", text, re.DOTALL)
    assert found is not None
    if os.environ.get("WRITE_DOCS"):
        PAGE.write_text(text.replace(found[0], table()), encoding="utf-8")
    else:
        assert found[0] == table()
