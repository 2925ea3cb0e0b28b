"""Expiry of the server's certificate: a metric, and a warning at the start and at each reload."""

from __future__ import annotations

import datetime
import logging
import re
import ssl
from pathlib import Path

import httpx
import pytest
from cryptography import x509

from rwt import Server, Settings
from tests.core.cli.test_broken_setups import certify

pytestmark = pytest.mark.anyio


# From 2050 on, certificates write their times in another form (RFC 5280 section 4.1.2.5).
@pytest.mark.parametrize("days", [60, 40_000], ids=["UTCTime", "GeneralizedTime"])
async def test_the_metric_is_the_end_of_the_certificate(days: int, tmp_path: Path) -> None:
    certfile, keyfile = certify(tmp_path, days)
    end = x509.load_pem_x509_certificate(certfile.read_bytes()).not_valid_after_utc
    settings = Settings.model_validate({"tls": {"certfile": certfile, "keyfile": keyfile}})
    async with Server("wss://localhost:0", settings=settings) as server:
        verify = ssl.create_default_context(cafile=str(certfile))
        async with httpx.AsyncClient(verify=verify, trust_env=False) as client:
            page = (await client.get(server.urls[0].replace("wss", "https", 1) + "/metrics")).text
    found = re.search(r"^rwt_certificate_expires_seconds (\S+)$", page, re.MULTILINE)
    assert found is not None
    assert datetime.datetime.fromtimestamp(float(found[1]), datetime.UTC) == end


@pytest.mark.parametrize(
    ("days", "warning"), [(-1, "has expired"), (29, "expires in 29 days"), (31, ""), (None, "")]
)
async def test_a_start_warns_of_the_end(
    days: int | None, warning: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    files = dict(zip(("certfile", "keyfile"), certify(tmp_path, days or 0), strict=True))
    settings = Settings.model_validate({"tls": {} if days is None else files})
    url = "ws://127.0.0.1:0" if days is None else "wss://127.0.0.1:0"
    with caplog.at_level(logging.WARNING):
        async with Server(url, settings=settings):
            pass
    warnings = [each.message for each in caplog.records if each.name == "rwt.tls.expiry"]
    assert len(warnings) == bool(warning)
    assert warning in "".join(warnings)
